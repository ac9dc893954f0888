#include "runtime/monitor/prometheus_text.h"

#include <ctime>

#include "common/base/log.h"
#include "common/base/memory.h"

namespace panofix {
namespace {

std::string Escaped(const std::string& label) {
  std::string text;
  for (const char c : label) {
    if (c == '\\' || c == '"') text += '\\';
    text += c == '\n' ? ' ' : c;
  }
  return text;
}

class Writer {
 public:
  void Metric(const char* name, const char* type, const char* help) {
    name_ = name;
    text_ += Format("# HELP %s %s\n# TYPE %s %s\n", name, help, name, type);
  }
  void Value(double value, const std::string& labels = "", const char* suffix = "") {
    text_ +=
        name_ + suffix + (labels.empty() ? "" : "{" + labels + "}") + Format(" %.15g\n", value);
  }
  void Count(const char* name, std::int64_t value, const char* help) {
    Metric(name, "counter", help);
    Value(static_cast<double>(value));
  }
  void Gauge(const char* name, double value, const char* help) {
    Metric(name, "gauge", help);
    Value(value);
  }
  std::string Take() { return std::move(text_); }

 private:
  std::string name_, text_;
};

void WriteFeed(const MonitorSnapshot& s, Writer* w) {
  w->Count("panofix_frames_received_total", s.feed.frames, "Frames that arrived.");
  w->Metric("panofix_frames_dropped_total", "counter", "Frames left out, by cause.");
  w->Value(static_cast<double>(s.feed.replaced), "cause=\"replaced\"");
  w->Value(static_cast<double>(s.feed.rate_limited), "cause=\"rate_limited\"");
  w->Value(static_cast<double>(s.num_camera_unknown), "cause=\"camera_unknown\"");
  w->Value(static_cast<double>(s.num_refused), "cause=\"refused\"");
  w->Count("panofix_frames_undecodable_total", s.num_undecodable,
           "Frames answered without a look at their pixels.");
  w->Count("panofix_calibrations_total", s.feed.calibrations, "Calibrations that arrived.");
  w->Count("panofix_calibrations_rival_total", s.num_rival_calibrations,
           "Of these, passed over: they differ from the one in use, which comes as well.");
  w->Count("panofix_messages_malformed_total", s.feed.malformed, "Messages not of two parts.");
  w->Count("panofix_messages_wrong_topic_total", s.feed.wrong_topic, "Messages of other topics.");
  w->Count("panofix_feed_connects_total", s.feed.connects, "Connections of the feed.");
  w->Count("panofix_feed_disconnects_total", s.feed.disconnects, "Connections that ended.");
  w->Metric("panofix_peers_denied_total", "counter", "Peers turned away for their key, by socket.");
  w->Value(static_cast<double>(s.feed.denied), "socket=\"frames\"");
  w->Value(static_cast<double>(s.num_denied_users), "socket=\"poses\"");
}

void WriteAnswers(const MonitorSnapshot& s, Writer* w) {
  w->Metric("panofix_answers_total", "counter", "Answers by status and reason.");
  for (const auto& [key, count] : s.answers) {
    w->Value(static_cast<double>(count),
             Format("status=\"%s\",reason=\"%s\"", FixStatusName(key.first),
                    Escaped(key.second).c_str()));
  }
  w->Count("panofix_requests_total", s.num_requests, "Requests that were replied to.");
  w->Count("panofix_requests_refused_total", s.num_requests_refused,
           "Of these, refused because they came faster than allowed.");
  w->Count("panofix_recorded_messages_total", s.num_recorded, "Messages written to the recording.");
  w->Count("panofix_not_recorded_messages_total", s.num_not_recorded,
           "Messages that the recording lacks.");
  w->Metric("panofix_latency_seconds", "histogram",
            "Time by stage; total is from a frame's arrival to its answer.");
  for (std::size_t stage = 0; stage < kNumServiceStages; ++stage) {
    const LatencyHistogram& h = s.latency[stage];
    const std::string label =
        Format("stage=\"%s\"", ServiceStageName(static_cast<ServiceStage>(stage)));
    for (std::size_t i = 0; i < LatencyHistogram::kUpper_ms.size(); ++i) {
      w->Value(static_cast<double>(h.NumUpTo(i)),
               label + Format(",le=\"%g\"", LatencyHistogram::kUpper_ms[i] / 1e3), "_bucket");
    }
    w->Value(static_cast<double>(h.num()), label + ",le=\"+Inf\"", "_bucket");
    w->Value(h.sum_ms() / 1e3, label, "_sum");
    w->Value(static_cast<double>(h.num()), label, "_count");
  }
}

void WriteMap(const MonitorSnapshot& s, std::int64_t now_s, Writer* w) {
  w->Metric("panofix_map_info", "gauge", "The map in use; always 1.");
  w->Value(1, Format("name=\"%s\",id=\"%s\",signed=\"%s\"", Escaped(s.bundle.name).c_str(),
                     Escaped(s.bundle.id).c_str(), s.bundle.is_signed ? "true" : "false"));
  w->Gauge("panofix_map_build", static_cast<double>(s.bundle.build), "Build of the map.");
  if (s.map_created_s > 0) {
    w->Gauge("panofix_map_age_seconds", static_cast<double>(now_s - s.map_created_s),
             "Since the map was signed.");
  }
  w->Gauge("panofix_map_tiles", static_cast<double>(s.num_tiles), "Tiles of the map.");
  w->Gauge("panofix_map_tiles_loaded", static_cast<double>(s.num_tiles_loaded), "Tiles in memory.");
  w->Gauge("panofix_map_tile_bytes", static_cast<double>(s.tile_bytes),
           "What they take of memory, indices included.");
  w->Count("panofix_tile_loads_total", s.num_tile_loads,
           "Tiles read since the map was opened, the first time included.");
  w->Count("panofix_tile_failures_total", s.num_tiles_failed,
           "Tiles that could not be read again.");
  w->Count("panofix_map_swaps_total", s.num_swaps, "Maps taken while running.");
  w->Count("panofix_map_swaps_failed_total", s.num_failed_swaps,
           "Times that a newer map did not open.");
}

}  // namespace

ProcessUse ReadProcessUse() {
  timespec cpu{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  return {ResidentMemoryBytes(),
          static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec)};
}

std::string ToPrometheusText(const MonitorSnapshot& snapshot, const ProcessUse& use,
                             std::int64_t now_s) {
  Writer w;
  WriteFeed(snapshot, &w);
  WriteAnswers(snapshot, &w);
  WriteMap(snapshot, now_s, &w);
  if (snapshot.since_answer_s) {
    w.Gauge("panofix_last_answer_age_seconds", *snapshot.since_answer_s, "Since the last answer.");
  }
  if (snapshot.since_fix_s) {
    w.Gauge("panofix_last_fix_age_seconds", *snapshot.since_fix_s, "Since the last fix.");
  }
  w.Gauge("panofix_uptime_seconds", snapshot.uptime_s, "Since the service started.");
  w.Gauge("process_resident_memory_bytes", static_cast<double>(use.resident_memory_bytes),
          "Resident memory.");
  w.Metric("process_cpu_seconds_total", "counter", "Processor time, user and system.");
  w.Value(use.cpu_s);
  return w.Take();
}

}  // namespace panofix
