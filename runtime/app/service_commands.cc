#include "runtime/app/service_commands.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "runtime/app/localizer_options.h"
#include "runtime/app/serve_store.h"
#include "runtime/app/wire_options.h"
#include "runtime/service/play.h"
#include "runtime/service/record.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

struct ServeCommand {
  ServeOptions serve;
  fs::path store;
  std::vector<fs::path> keys;
  WireKeyFiles wire;
  std::size_t max_frame_mb = 64;
};

void AddServeSockets(CLI::App* command, ServeCommand* o) {
  command
      ->add_option("--frames", o->serve.frames,
                   "camera feed to subscribe to, e.g. tcp://127.0.0.1:5601")
      ->required();
  command->add_option("--poses", o->serve.poses, "endpoint to publish poses on, e.g. tcp://*:5602")
      ->required();
  command->add_option("--requests", o->serve.requests,
                      "endpoint where single images are localized on request, e.g. "
                      "tcp://127.0.0.1:5603 (default: none)");
  AddSecretKeyOption(command, &o->wire);
  command->add_option("--camera-key", o->wire.server_key,
                      "public key of the camera: the feed is encrypted and no other is taken");
  AddBoundSocketOptions(command, &o->wire, "one who may have the poses");
  command
      ->add_option("--max-rate-hz", o->serve.max_rate_hz,
                   "frames that come faster are left out, requests refused; 0 = no bound")
      ->capture_default_str();
  command
      ->add_option("--max-frame-mb", o->max_frame_mb, "a larger message part ends the connection")
      ->capture_default_str()
      ->check(CLI::Range(1, 1024));
}

Status RunServe(ServeCommand* o) {
  if (o->store.empty() && o->serve.bundle.empty()) {
    return {ErrorCode::kInvalidArgument,
            "serve: give --store, or --bundle for development; see panofix-runtime serve --help"};
  }
  auto ring = ReadKeyRing(o->keys);
  if (!ring.ok()) return ring.status();
  o->serve.localizer.trusted_keys = *ring;
  o->serve.localizer.with_sight = o->serve.http_port.has_value();
  o->serve.max_message_bytes = o->max_frame_mb << 20;
  auto poses = BoundSecurity(o->wire);
  if (!poses.ok()) return poses.status();
  auto frames = ConnectSecurity(o->wire, "--camera-key");
  if (!frames.ok()) return frames.status();
  o->serve.poses_security = *poses;
  o->serve.frames_security = *frames;
  return o->store.empty() ? Serve(o->serve) : ServeStore(o->store, o->serve);
}

StoreCommand AddServe(CLI::App* app) {
  auto o = std::make_shared<ServeCommand>();
  CLI::App* command =
      app->add_subcommand("serve", "Localize a live camera feed and publish poses (ZeroMQ)");
  CLI::Option* bundle =
      command->add_option("--bundle", o->serve.bundle, "the map bundle's folder (development)");
  command
      ->add_option("--store", o->store, "the vehicle's store: its active map, signed and verified")
      ->excludes(bundle);
  AddTrustedKeyOption(command, &o->keys);
  AddServeSockets(command, o.get());
  command->add_option(
      "--camera", o->serve.camera,
      "camera.yaml of the feed. Without it the feed's own calibration is awaited for "
      "2 s from the first frame, frames being left unanswered, and then the "
      "bundle's is used");
  command
      ->add_option("--deadline-ms", o->serve.deadline_ms,
                   "answer no_fix once a frame is older than this; 0 = none. Looking a place up "
                   "takes some 450 ms of two processors: give 500 or more")
      ->capture_default_str();
  command->add_option("--http", o->serve.http_port,
                      "port on 127.0.0.1 for the live page, /metrics, /healthz and /readyz; "
                      "0 = any (default: none)");
  command->add_option("--record", o->serve.record,
                      "keep frames and poses as MCAP, in this file or folder (see replay)");
  command
      ->add_option("--max-frames", o->serve.max_frames,
                   "stop after so many frames; 0 = run until told to stop")
      ->capture_default_str();
  AddLocalizerOptions(command, &o->serve.localizer);
  return {command, [=] { return RunServe(o.get()); }};
}

StoreCommand AddPlay(CLI::App* app) {
  struct Options {
    PlayOptions play;
    WireKeyFiles wire;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand("play", "Publish a recorded drive as a camera would");
  command->add_option("--drive", o->play.drive, "folder with frames.csv and camera.yaml")
      ->required();
  command->add_option("--bind", o->play.bind, "endpoint to publish on, e.g. tcp://*:5601")
      ->required();
  command->add_option("--rate", o->play.rate_hz, "frames a second")->capture_default_str();
  command->add_flag("--loop", o->play.loop, "start again at the end");
  command->add_flag("--wait-for-subscriber", o->play.wait_for_subscriber,
                    "begin once somebody listens");
  command
      ->add_option("--subscriber-timeout-s", o->play.subscriber_timeout_s,
                   "give up waiting after this; 0 = never")
      ->capture_default_str();
  command->add_flag("--now", o->play.restamp_now, "stamp frames with the present time");
  AddSecretKeyOption(command, &o->wire);
  AddBoundSocketOptions(command, &o->wire, "a runtime that may have the frames");
  return {command, [=]() -> Status {
            auto security = BoundSecurity(o->wire);
            if (!security.ok()) return security.status();
            o->play.security = *security;
            return Play(o->play);
          }};
}

StoreCommand AddRecord(CLI::App* app) {
  struct Options {
    RecordOptions record;
    WireKeyFiles wire;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand("record", "Collect published poses into a poses.csv");
  command
      ->add_option("--poses", o->record.poses, "endpoint of the runtime, e.g. tcp://127.0.0.1:5602")
      ->required();
  command->add_option("--out", o->record.out, "poses.csv to write")->required();
  command->add_option("--log", o->record.log, "also write latencies and comparisons as JSON");
  command->add_option("--count", o->record.count, "stop after so many rows; 0 = until told to")
      ->capture_default_str();
  command
      ->add_option("--idle-timeout-s", o->record.idle_timeout_s,
                   "stop after this long without a pose; 0 = never")
      ->capture_default_str();
  AddSecretKeyOption(command, &o->wire);
  command->add_option("--server-key", o->wire.server_key, "public key of the runtime");
  return {command, [=]() -> Status {
            auto security = ConnectSecurity(o->wire, "--server-key");
            if (!security.ok()) return security.status();
            o->record.security = *security;
            return Record(o->record);
          }};
}

StoreCommand AddWireKey(CLI::App* app) {
  auto name = std::make_shared<fs::path>();
  CLI::App* command = app->add_subcommand(
      "wire-key",
      "Make a pair of keys for encrypted sockets: NAME.key stays, NAME.pub is given out");
  command->add_option("name", *name, "path without ending")->required();
  return {command, [=]() -> Status {
            const auto keys = MakeWireKeys();
            if (!keys.ok()) return keys.status();
            if (Status status = WriteWireKeys(*keys, *name); !status.ok()) return status;
            std::printf("%s.key\n%s.pub\n", name->c_str(), name->c_str());
            return {};
          }};
}

}  // namespace

std::vector<StoreCommand> AddServiceCommands(CLI::App* app) {
  return {AddServe(app), AddPlay(app), AddRecord(app), AddWireKey(app)};
}

}  // namespace panofix
