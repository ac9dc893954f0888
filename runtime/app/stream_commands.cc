#include "runtime/app/stream_commands.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "runtime/app/localizer_options.h"
#include "runtime/app/wire_options.h"
#include "runtime/service/messages.h"
#include "runtime/service/pose_lines.h"
#include "runtime/service/replay.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

struct TailOptions {
  std::string poses, format = "geojson";
  WireKeyFiles wire;
};

Status Tail(const TailOptions& o) {
  constexpr int kPoll_ms = 100;  // bounds the time to a stop
  const auto security = ConnectSecurity(o.wire, "--server-key");
  if (!security.ok()) return security.status();
  SubscriberOptions options;
  options.topics = {kPoseTopic};
  options.max_message_bytes = std::size_t{1} << 20;
  options.receive_queue_messages = 1000;
  options.security = *security;
  auto subscriber = Subscriber::Open(o.poses, options);
  if (!subscriber.ok()) return subscriber.status();
  while (!CancelRequested()) {
    auto message = subscriber->Receive(kPoll_ms);
    if (!message.ok()) return message.status();
    if (!message->has_value()) continue;
    const auto result = UnpackResult((*message)->payload);
    if (!result.ok()) continue;
    const std::string text = o.format == "nmea" ? ToNmea(result->row) : ToGeoJsonLine(result->row);
    if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() ||
        std::fflush(stdout) != 0) {
      return {ErrorCode::kIo, "tail: standard output is closed; end its reader after this program"};
    }
  }
  return {};
}

StoreCommand AddTail(CLI::App* app) {
  auto o = std::make_shared<TailOptions>();
  CLI::App* command = app->add_subcommand(
      "tail", "Print published poses line by line, for tools that know nothing of panofix");
  command->add_option("--poses", o->poses, "endpoint of the runtime, e.g. tcp://127.0.0.1:5602")
      ->required();
  command->add_option("--format", o->format, "nmea (GGA, HDT, GST) or geojson")
      ->capture_default_str()
      ->check(CLI::IsMember({"nmea", "geojson"}));
  AddSecretKeyOption(command, &o->wire);
  command->add_option("--server-key", o->wire.server_key, "public key of the runtime");
  return {command, [=] { return Tail(*o); }};
}

struct ReplayOptions {
  fs::path recording, out;
  std::vector<fs::path> bundles, keys;
};

Status RunReplay(const ReplayOptions& o) {
  const auto ring = ReadKeyRing(o.keys);
  if (!ring.ok()) return ring.status();
  const auto report = Replay(o.recording, OpenerOver(o.bundles, *ring));
  if (!report.ok()) return report.status();
  if (report->was_cut) LogWarning(o.recording.string() + ": lacks its end, as after a crash");
  if (!o.out.empty()) {
    if (Status status = WriteFileAtomically(o.out, FormatPoses(report->rows, PoseFormat::kCsv));
        !status.ok()) {
      return status;
    }
  }
  const auto n = [](std::int64_t value) { return static_cast<long long>(value); };
  std::printf("%lld frames, %lld fixes, %lld answers differ from the recorded ones\n",
              n(report->num_frames), n(report->num_fixes), n(report->num_different));
  if (report->num_not_compared > 0) {
    LogWarning(Format("%s: lacks frames; the %lld answers after them were not compared",
                      o.recording.c_str(), n(report->num_not_compared)));
  }
  if (report->num_different == 0) return {};
  return {ErrorCode::kChecksumMismatch,
          Format("%s: %lld answers differ, the first at %lld; was it recorded by another version "
                 "of this program?",
                 o.recording.c_str(), n(report->num_different), n(report->first_different_ns))};
}

StoreCommand AddReplay(CLI::App* app) {
  auto o = std::make_shared<ReplayOptions>();
  CLI::App* command = app->add_subcommand(
      "replay", "Answer a recording of serve --record anew, and compare bit for bit");
  command->add_option("recording", o->recording, "MCAP file")->required();
  command->add_option("--bundle", o->bundles, "folder of a map that it used; may be repeated")
      ->required();
  command->add_option("--out", o->out, "also write the poses as poses.csv");
  AddTrustedKeyOption(command, &o->keys);
  return {command, [=] { return RunReplay(*o); }};
}

}  // namespace

std::vector<StoreCommand> AddStreamCommands(CLI::App* app) {
  return {AddTail(app), AddReplay(app)};
}

}  // namespace panofix
