// panofix-runtime: the on-line half. Options to calls, and failures to one line and an exit code.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "common/base/cancel.h"
#include "common/base/command_line.h"
#include "common/base/log.h"
#include "runtime/app/localize.h"
#include "runtime/app/localizer_options.h"
#include "runtime/app/service_commands.h"
#include "runtime/app/store_commands.h"
#include "runtime/app/stream_commands.h"

namespace {

using panofix::Status;

constexpr const char* kExamples = R"(
Examples:
  panofix-runtime localize --bundle map --drive drive --out poses.csv
  panofix-runtime serve --bundle map --frames tcp://127.0.0.1:5601 --poses 'tcp://*:5602'
  panofix-runtime play --drive drive --bind 'tcp://*:5601' --rate 10
  panofix-runtime record --poses tcp://127.0.0.1:5602 --out poses.csv
  panofix-runtime tail --poses tcp://127.0.0.1:5602 --format nmea
Between machines, encrypted:
  panofix-runtime wire-key vehicle
  panofix-runtime serve --bundle map --frames tcp://camera:5601 --poses 'tcp://*:5602' \
    --secret-key vehicle.key --camera-key camera.pub --client-key display.pub --http 8080
On a vehicle:
  panofix-runtime init --store /var/lib/panofix --map city --camera camera.yaml --key map.pub
  panofix-runtime install --store /var/lib/panofix http://maps.example/city-42.pfb --activate
  panofix-runtime serve --store /var/lib/panofix --frames ipc:///run/camera --poses 'tcp://*:5602'
  panofix-runtime rollback --store /var/lib/panofix

Exit codes: 0 done, 64 wrong use, 65 bad data, 66 not found, 74 disk or network, 75 try again,
76 format not readable, 77 not signed with a trusted key, 130 interrupted. Refused maps: 80 key
revoked, 81 older than one seen, 82 expired, 83 mixed parts, 84 endless data, 85 incomplete,
86 another camera, 87 another map, 88 does not run here.)";

Status Dispatch(int argc, char** argv, int* parse_exit) {
  CLI::App app("panofix-runtime: where a vehicle is, from one camera and a map bundle");
  app.footer(kExamples);
  app.set_version_flag("--version", "panofix-runtime " PANOFIX_VERSION);
  app.require_subcommand(1);
  std::string log_level = "info";
  app.add_option("--log-level", log_level, "debug, info, warning, error or off")
      ->capture_default_str();

  std::vector<std::filesystem::path> keys;
  panofix::LocalizeOptions localize;
  CLI::App* localize_command =
      app.add_subcommand("localize", "Localize a recorded drive, frame by frame");
  localize_command->add_option("--bundle", localize.bundle, "the map bundle's folder")->required();
  localize_command->add_option("--drive", localize.drive, "folder with frames.csv and camera.yaml")
      ->required();
  localize_command->add_option("--out", localize.out, "poses to write")->required();
  localize_command->add_option("--format", localize.format, "csv, tum, geojson or gpx")
      ->capture_default_str();
  localize_command->add_option("--log", localize.log,
                               "also write latencies and comparisons as JSON");
  panofix::AddTrustedKeyOption(localize_command, &keys);
  panofix::AddLocalizerOptions(localize_command, &localize.localizer);

  const std::vector<panofix::StoreCommand> service_commands = panofix::AddServiceCommands(&app);
  const std::vector<panofix::StoreCommand> stream_commands = panofix::AddStreamCommands(&app);
  const std::vector<panofix::StoreCommand> store_commands = panofix::AddStoreCommands(&app);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() != 0) {
      const std::string unknown =
          app.get_subcommands().empty() ? panofix::UnknownCommand(argc, argv) : "";
      return {
          panofix::ErrorCode::kInvalidArgument,
          (unknown.empty() ? std::string(error.what()) : unknown) + "; see panofix-runtime --help"};
    }
    *parse_exit = app.exit(error);  // --help, --version
    return {};
  }
  if (!panofix::SetLogLevel(log_level)) {
    return {panofix::ErrorCode::kInvalidArgument,
            "--log-level " + log_level + ": unknown; use debug, info, warning, error or off"};
  }
  panofix::InstallCancelHandlers();
  for (const auto* commands : {&service_commands, &stream_commands, &store_commands}) {
    for (const auto& [command, run] : *commands) {
      if (command->parsed()) return run();
    }
  }
  auto ring = panofix::ReadKeyRing(keys);
  if (!ring.ok()) return ring.status();
  localize.localizer.trusted_keys = *ring;
  return panofix::LocalizeDrive(localize);
}

}  // namespace

int main(int argc, char** argv) {
  int parse_exit = -1;
  Status status;
  try {
    status = Dispatch(argc, argv, &parse_exit);
  } catch (const std::exception& error) {
    status = {panofix::ErrorCode::kInternal, error.what()};
  }
  if (parse_exit >= 0) return parse_exit;
  if (!status.ok()) std::fprintf(stderr, "panofix-runtime: %s\n", status.message().c_str());
  return panofix::ExitCode(status.code());
}
