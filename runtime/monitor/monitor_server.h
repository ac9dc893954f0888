#pragma once
// HTTP for those who watch the service: loopback only, reading only.

#include <cstdint>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "runtime/monitor/service_monitor.h"

namespace panofix {

struct MonitorServerOptions {
  int port = 0;        // on 127.0.0.1; 0 = the system chooses
  double hang_s = 10;  // the loop has not turned for so long: /healthz says 503
  double quiet_s = 3;  // no answer for so long: /readyz says 503
  void Check() const;  // throws std::invalid_argument
};

// GET /metrics, /healthz, /readyz, / (the live page), /api/live?after=N, /api/route,
// /api/frame. A request whose
// Host is not this machine is refused, so that a page from elsewhere cannot read through a browser.
class MonitorServer {
 public:
  // `monitor` outlives the server. kIo names the port and the mend.
  [[nodiscard]] static Result<std::unique_ptr<MonitorServer>> Start(
      const MonitorServerOptions& options, const ServiceMonitor& monitor);
  ~MonitorServer();  // ends what is under way
  MonitorServer(const MonitorServer&) = delete;
  MonitorServer& operator=(const MonitorServer&) = delete;
  [[nodiscard]] int port() const;

 private:
  struct Impl;
  explicit MonitorServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix
