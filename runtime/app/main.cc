// panofix-runtime: the on-line half. Options to calls, and failures to one line and an exit code.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "runtime/app/localize.h"
#include "runtime/app/serve_store.h"
#include "runtime/app/store_commands.h"
#include "runtime/localizer/levers.h"
#include "runtime/service/play.h"
#include "runtime/service/record.h"
#include "runtime/service/serve.h"

namespace {

using panofix::Status;

constexpr const char* kExamples = R"(
Examples:
  panofix-runtime localize --bundle map --drive drive --out poses.csv
  panofix-runtime serve --bundle map --frames tcp://127.0.0.1:5601 --poses 'tcp://*:5602'
  panofix-runtime play --drive drive --bind 'tcp://*:5601' --rate 10
  panofix-runtime record --poses tcp://127.0.0.1:5602 --out poses.csv
On a vehicle:
  panofix-runtime init --store /var/lib/panofix --map city --camera camera.yaml --key map.pub
  panofix-runtime install --store /var/lib/panofix http://maps.example/city-42.pfb --activate
  panofix-runtime serve --store /var/lib/panofix --frames ipc:///run/camera --poses 'tcp://*:5602'
  panofix-runtime rollback --store /var/lib/panofix

Exit codes: 0 done, 64 wrong use, 65 bad data, 66 not found, 74 disk or network, 75 try again,
76 format not readable, 77 not signed with a trusted key, 130 interrupted. Refused maps: 80 key
revoked, 81 older than one seen, 82 expired, 83 mixed parts, 84 endless data, 85 incomplete,
86 another camera, 87 another map, 88 does not run here.)";

// Files of public keys, read once the command line is.
void AddKeyOption(CLI::App* command, std::vector<std::filesystem::path>* keys) {
  command->add_option("--trusted-key", *keys,
                      "public key that the bundle must be signed with; may be repeated (default: "
                      "the bundle may be unsigned, and every pose says so)");
}

void AddLocalizerOptions(CLI::App* command, panofix::LocalizerOptions* options) {
  command
      ->add_option("--preset", options->preset,
                   "default, or paper: the published method, for comparison (its maps too)")
      ->capture_default_str();
  command
      ->add_option("--add", options->add,
                   "what the default has over the paper, piece by piece, for ablations:\n" +
                       panofix::LeverHelp())
      ->delimiter(',')
      ->type_name("LEVER[,LEVER...]");
  command->add_option("--threads", options->num_threads, "processors to use; 0 = all")
      ->capture_default_str();
  command->add_option("--seed", options->seed, "seed of the robust search; same frames, same poses")
      ->capture_default_str();
}

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
  AddKeyOption(localize_command, &keys);
  AddLocalizerOptions(localize_command, &localize.localizer);

  panofix::ServeOptions serve;
  CLI::App* serve_command =
      app.add_subcommand("serve", "Localize a live camera feed and publish poses (ZeroMQ)");
  std::filesystem::path store;
  CLI::Option* bundle_option =
      serve_command->add_option("--bundle", serve.bundle, "the map bundle's folder (development)");
  serve_command
      ->add_option("--store", store, "the vehicle's store: its active map, signed and verified")
      ->excludes(bundle_option);
  AddKeyOption(serve_command, &keys);
  serve_command
      ->add_option("--frames", serve.frames,
                   "camera feed to subscribe to, e.g. tcp://127.0.0.1:5601")
      ->required();
  serve_command
      ->add_option("--poses", serve.poses, "endpoint to publish poses on, e.g. tcp://*:5602")
      ->required();
  serve_command->add_option("--camera", serve.camera,
                            "camera.yaml; default: from the feed, else from the bundle");
  serve_command
      ->add_option("--deadline-ms", serve.deadline_ms,
                   "answer no_fix once a frame is older than this; 0 = none")
      ->capture_default_str();
  serve_command->add_option("--http", serve.http_port,
                            "port on 127.0.0.1 for the live page, /metrics, /healthz and /readyz; "
                            "0 = any (default: none)");
  serve_command
      ->add_option("--max-frames", serve.max_frames,
                   "stop after so many frames; 0 = run until told to stop")
      ->capture_default_str();
  AddLocalizerOptions(serve_command, &serve.localizer);

  panofix::PlayOptions play;
  CLI::App* play_command = app.add_subcommand("play", "Publish a recorded drive as a camera would");
  play_command->add_option("--drive", play.drive, "folder with frames.csv and camera.yaml")
      ->required();
  play_command->add_option("--bind", play.bind, "endpoint to publish on, e.g. tcp://*:5601")
      ->required();
  play_command->add_option("--rate", play.rate_hz, "frames a second")->capture_default_str();
  play_command->add_flag("--loop", play.loop, "start again at the end");
  play_command->add_flag("--wait-for-subscriber", play.wait_for_subscriber,
                         "begin once somebody listens");
  play_command
      ->add_option("--subscriber-timeout-s", play.subscriber_timeout_s,
                   "give up waiting after this; 0 = never")
      ->capture_default_str();
  play_command->add_flag("--now", play.restamp_now, "stamp frames with the present time");

  panofix::RecordOptions record;
  CLI::App* record_command =
      app.add_subcommand("record", "Collect published poses into a poses.csv");
  record_command
      ->add_option("--poses", record.poses, "endpoint of the runtime, e.g. tcp://127.0.0.1:5602")
      ->required();
  record_command->add_option("--out", record.out, "poses.csv to write")->required();
  record_command->add_option("--log", record.log, "also write latencies and comparisons as JSON");
  record_command->add_option("--count", record.count, "stop after so many rows; 0 = until told to")
      ->capture_default_str();
  record_command
      ->add_option("--idle-timeout-s", record.idle_timeout_s,
                   "stop after this long without a pose; 0 = never")
      ->capture_default_str();

  const std::vector<panofix::StoreCommand> store_commands = panofix::AddStoreCommands(&app);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() != 0) {
      return {panofix::ErrorCode::kInvalidArgument,
              std::string(error.what()) + "; see panofix-runtime --help"};
    }
    *parse_exit = app.exit(error);  // --help, --version
    return {};
  }
  if (!panofix::SetLogLevel(log_level)) {
    return {panofix::ErrorCode::kInvalidArgument,
            "--log-level " + log_level + ": unknown; use debug, info, warning, error or off"};
  }
  panofix::InstallCancelHandlers();
  for (const auto& [command, run] : store_commands) {
    if (command->parsed()) return run();
  }
  auto ring = panofix::ReadKeyRing(keys);
  if (!ring.ok()) return ring.status();
  localize.localizer.trusted_keys = serve.localizer.trusted_keys = *ring;
  if (localize_command->parsed()) return panofix::LocalizeDrive(localize);
  if (serve_command->parsed() && store.empty() && serve.bundle.empty()) {
    return {panofix::ErrorCode::kInvalidArgument,
            "serve: give --store, or --bundle for development; see panofix-runtime serve --help"};
  }
  if (serve_command->parsed())
    return store.empty() ? panofix::Serve(serve) : panofix::ServeStore(store, serve);
  if (play_command->parsed()) return panofix::Play(play);
  return panofix::Record(record);
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
