// inspect, validate and score: what a finished bundle is and is worth.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "builder/app/commands.h"
#include "builder/pipeline/release.h"
#include "builder/validate/birds_eye.h"
#include "builder/validate/inspect.h"
#include "builder/validate/replay.h"
#include "builder/validate/score.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

struct Gate {
  double min_fix = 0, min_within_1m = 0.5;
  double max_false_fixes = 0;
  void AddOptions(CLI::App* command) {
    command->add_option("--min-fix-share", min_fix, "least share of frames with a fix")
        ->check(CLI::Range(0.0, 1.0))
        ->capture_default_str();
    command
        ->add_option("--min-share-1m", min_within_1m, "least share of frames within (1 m, 5 deg)")
        ->check(CLI::Range(0.0, 1.0))
        ->capture_default_str();
    command->add_option("--max-false-fix-share", max_false_fixes, "largest share of false fixes")
        ->check(CLI::Range(0.0, 1.0))
        ->capture_default_str();
  }
  // Prints a line a broken threshold; true where all hold.
  [[nodiscard]] bool Holds(const ScoreTable& table) const {
    bool holds = true;
    const auto require = [&](bool ok, const std::string& line) {
      if (!ok) std::fprintf(stderr, "panofix-builder: quality gate: %s\n", line.c_str());
      holds = holds && ok;
    };
    const double fix = table.Share(table.num_fixes), within = table.Share(table.num_within[2]);
    const double false_fixes = table.Share(table.num_false_fixes);
    require(
        fix >= min_fix,
        Format("%.3f of the frames have a fix, %.3f are wanted (--min-fix-share)", fix, min_fix));
    require(within >= min_within_1m,
            Format("%.3f of the frames lie within (1 m, 5 deg), %.3f are wanted (--min-share-1m)",
                   within, min_within_1m));
    require(false_fixes <= max_false_fixes,
            Format("%.3f of the frames are false fixes, %.3f are allowed "
                   "(--max-false-fix-share)",
                   false_fixes, max_false_fixes));
    return holds;
  }
};

double MbPerKm(const MapBundle& bundle) {
  const double length_m = RouteLength_m(bundle);
  return length_m > 0 ? static_cast<double>(BundleBytes(bundle)) / 1e6 / (length_m / 1000) : 0.0;
}

void Deliver(const ScoreTable& table, const fs::path& json, const fs::path& picture,
             const MapBundle& bundle, const Drive& drive, const std::vector<PoseRow>& poses) {
  std::fputs(table.ToText().c_str(), stdout);
  if (!json.empty()) ThrowIfError(WriteFileAtomically(json, table.ToJson()));
  if (!picture.empty())
    ThrowIfError(WriteFileAtomically(picture, BirdsEyeSvg(bundle, drive, poses)));
}

void CheckOutputs(std::initializer_list<std::pair<const char*, fs::path>> outputs) {
  for (const auto& [option, path] : outputs) {
    if (!path.empty()) ThrowIfError(CheckFileCanBeWritten(path, option));
  }
}

Drive ReadDriveWithTruth(const fs::path& folder) {
  Drive drive = ValueOrThrow(ReadDrive(folder));
  if (drive.truth.empty()) {
    throw Error(ErrorCode::kNotFound,
                (folder / "truth.csv").string() + ": not there or empty; a score needs the truth");
  }
  return drive;
}

}  // namespace

Command AddInspectCommand(CLI::App* app) {
  struct Options {
    fs::path bundle;
    std::vector<fs::path> keys;
    bool json = false;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "inspect",
      "Say what a bundle or a vocabulary release is: versions, signature, counts, size, coverage");
  command->add_option("bundle", o->bundle, "the bundle's folder, or a vocabulary.h5")->required();
  command->add_option("--trusted-key", o->keys,
                      "public key that its signature must be of; may be repeated");
  command->add_flag("--json", o->json, "as JSON");
  return [=] {
    if (fs::is_regular_file(o->bundle)) {
      std::fputs(DescribeRelease(o->bundle, o->json).c_str(), stdout);
      return 0;
    }
    const KeyRing ring = ValueOrThrow(ReadKeyRing(o->keys));
    const SignatureState signature =
        SignatureStateOf(ValueOrThrow(ReadSignedManifest(o->bundle, {})), ring,
                         (o->bundle / kManifestName).string());
    if (!ring.empty() && !signature.status.ok()) {
      // Whoever names keys wants no other map opened.
      std::fputs((o->json ? SignatureJson(signature) : SignatureText(signature)).c_str(), stdout);
      throw Error(signature.status);
    }
    const auto bundle = ValueOrThrow(MapBundle::Open(o->bundle, ring));
    std::fputs(
        (o->json ? InspectJson(*bundle, signature) : InspectText(*bundle, signature)).c_str(),
        stdout);
    return 0;
  };
}

Command AddValidateCommand(CLI::App* app) {
  struct Options {
    fs::path bundle, drive, json, poses, picture, runtime;
    std::string preset = "default";
    Gate gate;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app->add_subcommand("validate", "Replay a drive with truth through the runtime and score it");
  command->add_option("bundle", o->bundle, "the bundle's folder")->required();
  command->add_option("--drive", o->drive, "folder with frames.csv, camera.yaml and truth.csv")
      ->required();
  command->add_option("--json", o->json, "also write the score as JSON");
  command->add_option("--poses", o->poses, "also keep the poses as CSV");
  command->add_option("--picture", o->picture, "also draw a bird's-eye view as SVG");
  command->add_option("--preset", o->preset, "the runtime's preset: default or paper")
      ->capture_default_str();
  command->add_option("--runtime", o->runtime,
                      "panofix-runtime to use (default: beside this program, or in PATH)");
  o->gate.AddOptions(command);
  return [=] {
    CheckOutputs({{"--json", o->json}, {"--poses", o->poses}, {"--picture", o->picture}});
    const Drive drive = ReadDriveWithTruth(o->drive);
    const auto bundle = ValueOrThrow(MapBundle::Open(o->bundle));
    const fs::path runtime = o->runtime.empty() ? ValueOrThrow(FindRuntime()) : o->runtime;
    const Replay replay = ReplayDrive(runtime, o->bundle, o->drive, {"--preset", o->preset});
    const ScoreTable table = Score(drive, replay.poses, replay.log, MbPerKm(*bundle));
    if (!o->poses.empty()) {
      ThrowIfError(WriteFileAtomically(o->poses, FormatPoses(replay.poses, PoseFormat::kCsv)));
    }
    Deliver(table, o->json, o->picture, *bundle, drive, replay.poses);
    return o->gate.Holds(table) ? 0 : 1;
  };
}

Command AddScoreCommand(CLI::App* app) {
  struct Options {
    fs::path poses, drive, bundle, log, json, picture;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "score", "Score a poses.csv that a runtime wrote against a drive's truth");
  command->add_option("--poses", o->poses, "poses.csv")->required();
  command->add_option("--drive", o->drive, "folder with frames.csv, camera.yaml and truth.csv")
      ->required();
  command->add_option("--bundle", o->bundle, "the bundle's folder")->required();
  command->add_option("--log", o->log, "the runtime's log, for latency and comparisons");
  command->add_option("--json", o->json, "also write the score as JSON");
  command->add_option("--picture", o->picture, "also draw a bird's-eye view as SVG");
  return [=] {
    CheckOutputs({{"--json", o->json}, {"--picture", o->picture}});
    const Drive drive = ReadDriveWithTruth(o->drive);
    const auto bundle = ValueOrThrow(MapBundle::Open(o->bundle));
    const std::vector<PoseRow> poses = ValueOrThrow(ReadPosesCsv(o->poses));
    const RunLog log = o->log.empty() ? RunLog{} : ValueOrThrow(ReadRunLog(o->log));
    Deliver(Score(drive, poses, log, MbPerKm(*bundle)), o->json, o->picture, *bundle, drive, poses);
    return 0;
  };
}

}  // namespace panofix
