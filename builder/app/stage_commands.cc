// The stages of a planned build as programs: one unit a call, for engines that run many at once.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <new>

#include "builder/app/commands.h"
#include "builder/pipeline/build.h"
#include "builder/pipeline/stages.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

const char* Describe(Stage stage) {
  switch (stage) {
    case Stage::kExtract:
      return "Stage: features of a shard's panoramas";
    case Stage::kAugment:
      return "Stage: features of the views rendered between a shard's panoramas";
    case Stage::kSample:
      return "Stage: a shard's descriptors to train on (not with a vocabulary release)";
    case Stage::kTrain:
      return "Stage: the vocabulary's trees, trained or taken from the release";
    case Stage::kWords:
      return "Stage: visual words of a shard's views";
    case Stage::kWeigh:
      return "Stage: weights of the words, over all shards";
    case Stage::kLandmarks:
      return "Stage: a tile's part of the bundle";
    case Stage::kSimilarity:
      return "Stage: a tile's rows of the similarity index";
    case Stage::kAssemble:
      return "Stage: graph and manifest of all tiles";
  }
  return "";
}

// Engines act on the exit code: 75 = the same call may succeed another time, perhaps with more
// memory or on another machine; 65 and 64 = it never will.
int ForEngines(const std::function<int()>& run) {
  try {
    return run();
  } catch (const Error& error) {
    const bool may_pass = error.code() == ErrorCode::kIo || error.code() == ErrorCode::kNoSpace;
    if (!may_pass) throw;
    throw Error(ErrorCode::kTryAgain, error.what());
  } catch (const std::bad_alloc&) {
    throw Error(ErrorCode::kTryAgain, "out of memory; run this stage again with more of it");
  }
}

struct StageOptions {
  fs::path work, out;
  std::string unit = kAllUnit;
  int num_threads = 0;
};

void AddCommon(CLI::App* command, StageOptions* o) {
  command->add_option("--work", o->work, "work folder of the plan")->required();
  command->add_option("--threads", o->num_threads, "processors to use; 0 = all")
      ->capture_default_str();
}

void Say(const UnitReport& report) {
  std::printf("%s %s: %lld of %lld made, %.1f s\n", report.stage.c_str(), report.unit.c_str(),
              static_cast<long long>(report.num_new + report.num_redone),
              static_cast<long long>(report.num_items), report.duration_s);
}

Command AddStageCommand(CLI::App* app, Stage stage) {
  auto o = std::make_shared<StageOptions>();
  CLI::App* command = app->add_subcommand(StageName(stage), Describe(stage));
  AddCommon(command, o.get());
  if (UnitOf(stage) == StageUnit::kShard)
    command->add_option("--shard", o->unit, "quadkey of the shard, as in the plan")->required();
  if (UnitOf(stage) == StageUnit::kTile)
    command->add_option("--tile", o->unit, "quadkey of the tile, as in the plan")->required();
  return [=] {
    return ForEngines([&] {
      const ThreadLimit threads(o->num_threads);
      const BuildContext context(o->work);
      Say(RunStage(context, stage, o->unit));
      return 0;
    });
  };
}

Command AddPublishCommand(CLI::App* app) {
  auto o = std::make_shared<StageOptions>();
  CLI::App* command = app->add_subcommand("publish", "Publish what was assembled: the last stage");
  AddCommon(command, o.get());
  command->add_option("--out", o->out, "folder of the bundle (default: the plan's)");
  return [=] {
    return ForEngines([&] {
      const ThreadLimit threads(o->num_threads);
      const BuildContext context(o->work);
      fs::path out = o->out.empty() ? context.plan.options.out : o->out;
      if (!out.has_filename()) out = out.parent_path();
      CheckOut(out);
      const RunReport report = Publish(context, out);
      std::fputs(report.ToTable().c_str(), stdout);
      std::printf("bundle %s is ready; see it with: panofix-builder inspect %s\n", out.c_str(),
                  out.c_str());
      return 0;
    });
  };
}

}  // namespace

std::vector<Command> AddStageCommands(CLI::App* app) {
  std::vector<Command> commands;
  for (const Stage stage : kAllStages) commands.push_back(AddStageCommand(app, stage));
  commands.push_back(AddPublishCommand(app));
  return commands;
}

}  // namespace panofix
