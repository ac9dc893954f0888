// panofix-builder: the offline half. Options to calls, and failures to one line and an exit code.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <stdexcept>

#include "builder/app/commands.h"
#include "common/base/cancel.h"
#include "common/base/command_line.h"
#include "common/base/log.h"
#include "common/base/status.h"

namespace {

using panofix::ErrorCode;

constexpr const char* kExamples = R"(
Examples:
  panofix-builder build --panoramas panoramas.geojson --camera camera.yaml --out map
  panofix-builder inspect map
  panofix-builder validate map --drive drive
  panofix-builder depth pano.gsv --pixel 256,150
  panofix-builder keygen --key map.key --public map.pub
  panofix-builder sign map --key map.key --expires-days 30
  panofix-builder delta map-41 map-42 --out city-41-42.pfb

A build by stages, each a program, for builds that outgrow a machine (jobs/README.md):
  panofix-builder plan --panoramas panoramas.geojson --camera camera.yaml --out map
  panofix-builder extract --work map.work --shard 120220013310321

Exit codes: 0 done, 1 the quality gate does not hold, 64 wrong use, 65 bad data, 66 not found,
74 disk, 75 a stage that may succeed another time, 76 bundle format not readable, 77 not signed,
130 interrupted (run the same build again to resume).)";

int Dispatch(int argc, char** argv) {
  CLI::App app("panofix-builder: map bundles from street panoramas");
  app.footer(kExamples);
  app.set_version_flag("--version", "panofix-builder " PANOFIX_VERSION);
  app.require_subcommand(1);
  std::string log_level = "info";
  app.add_option("--log-level", log_level, "debug, info, warning, error or off")
      ->capture_default_str();
  std::vector<panofix::Command> commands = {
      panofix::AddBuildCommand(&app),    panofix::AddInspectCommand(&app),
      panofix::AddValidateCommand(&app), panofix::AddScoreCommand(&app),
      panofix::AddDepthCommand(&app),    panofix::AddPlanCommand(&app),
      panofix::AddKeygenCommand(&app),   panofix::AddEndorseCommand(&app),
      panofix::AddSignCommand(&app),     panofix::AddDeltaCommand(&app),
      panofix::AddPackCommand(&app),     panofix::AddMigrateCommand(&app)};
  for (panofix::Command& stage : panofix::AddStageCommands(&app))
    commands.push_back(std::move(stage));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    const std::string unknown =
        app.get_subcommands().empty() ? panofix::UnknownCommand(argc, argv) : "";
    throw panofix::Error(
        ErrorCode::kInvalidArgument,
        (unknown.empty() ? std::string(error.what()) : unknown) + "; see panofix-builder --help");
  }
  if (!panofix::SetLogLevel(log_level)) {
    throw panofix::Error(
        ErrorCode::kInvalidArgument,
        "--log-level " + log_level + ": unknown; use debug, info, warning, error or off");
  }
  panofix::InstallCancelHandlers();
  const auto subcommands = app.get_subcommands({});
  for (std::size_t i = 0; i < subcommands.size(); ++i) {
    if (subcommands[i]->parsed()) return commands[i]();
  }
  return panofix::ExitCode(ErrorCode::kInternal);
}

int Fail(ErrorCode code, const char* message) {
  std::fprintf(stderr, "panofix-builder: %s\n", message);
  return panofix::ExitCode(code);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return Dispatch(argc, argv);
  } catch (const panofix::Error& error) {
    return Fail(error.code(), error.what());
  } catch (const std::invalid_argument& error) {
    return Fail(ErrorCode::kInvalidArgument, error.what());
  } catch (const std::exception& error) {
    return Fail(ErrorCode::kInternal, error.what());
  }
}
