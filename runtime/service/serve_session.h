#pragma once
// One run of the service: a loop over the newest frames. Private to this module.

#include <memory>
#include <optional>

#include "runtime/monitor/monitor_server.h"
#include "runtime/service/engine_keeper.h"
#include "runtime/service/frame_receiver.h"
#include "runtime/service/messages.h"
#include "runtime/service/request_server.h"
#include "runtime/service/session_recorder.h"
#include "runtime/service/sockets.h"

namespace panofix {

class ServeSession {
 public:
  // `options` and `source` outlive it.
  ServeSession(const ServeOptions& options, EngineSource& source, Publisher publisher);
  // Until it is told to stop, or the first error.
  [[nodiscard]] Status Run();

 private:
  [[nodiscard]] Status Start();
  [[nodiscard]] Status StartHttp();
  [[nodiscard]] Status StartRequests();
  [[nodiscard]] Status Step();
  [[nodiscard]] Status HandleFrame(const ArrivedFrame& arrived);
  struct Answered {
    FrameResult result;
    double decode_ms = 0;
    int stopped_at_step = 0;  // see SessionRecorder
  };
  [[nodiscard]] Status Publish(const IncomingFrame& frame, const Answered& answered);
  // What the engine answers to a frame, or what is to be said of one that does not decode.
  [[nodiscard]] Answered Answer(const IncomingFrame& frame,
                                std::chrono::steady_clock::time_point arrived);
  void FollowEngine();
  void CountTiles();
  // Says once that the deadline leaves no time to find a place.
  void WatchDeadline(const FrameResult& result);
  void ShowPicture(const IncomingFrame& frame, const FrameResult& result);
  void Report();

  const ServeOptions& options_;
  ServiceMonitor monitor_;
  EngineKeeper engines_;
  Publisher publisher_;
  std::unique_ptr<FrameReceiver> receiver_;
  std::unique_ptr<MonitorServer> http_;
  std::unique_ptr<SessionRecorder> recorder_;
  std::unique_ptr<RequestServer> requests_;  // ends before what it uses
  int generation_ = 0;
  std::optional<std::chrono::steady_clock::time_point> first_frame_;
  std::chrono::steady_clock::time_point reported_ = std::chrono::steady_clock::now();
  std::int64_t num_answers_ = 0;
  int num_cut_ = 0;  // frames that the deadline ended since the last pose
  bool is_deadline_told_ = false;
  LogThrottle frame_log_, decode_log_;
};

}  // namespace panofix
