#include "runtime/service/serve.h"

#include <stdexcept>

#include "common/base/cancel.h"
#include "runtime/service/serve_session.h"
#include "runtime/service/sockets.h"

namespace panofix {

void ServeOptions::Check() const {
  const auto require = [](bool holds, const char* rule) {
    if (!holds) throw std::invalid_argument(rule);
  };
  require(!bundle.empty(), "bundle is empty; name the bundle's folder");
  for (const Status& status : {CheckEndpoint("frames", frames), CheckEndpoint("poses", poses)}) {
    require(status.ok(), status.message().c_str());
  }
  const Status asked = requests.empty() ? Status() : CheckEndpoint("requests", requests);
  require(asked.ok(), asked.message().c_str());
  require(camera_wait_s >= 0, "camera_wait_s must be 0 or above");
  require(calibration_hold_s >= 0, "calibration_hold_s must be 0 or above");
  require(max_message_bytes >= 1024, "max_message_bytes must be 1024 or above");
  require(max_rate_hz >= 0, "max_rate_hz must be 0 or above");
  require(quiet_warning_s > 0, "quiet_warning_s must be above 0");
  require(report_interval_s > 0, "report_interval_s must be above 0");
  require(deadline_ms >= 0, "deadline_ms must be 0 or above");
  require(update_interval_s > 0, "update_interval_s must be above 0");
  require(retry_wait_s > 0, "retry_wait_s must be above 0");
  require(max_retry_wait_s >= retry_wait_s, "max_retry_wait_s must be retry_wait_s or above");
  require(!http_port || (*http_port >= 0 && *http_port <= 65535), "http port must be 0 to 65535");
  require(max_frames >= 0, "max_frames must be 0 or above");
}

Status ServeFrom(const ServeOptions& options, EngineSource& source) {
  try {
    options.Check();
    PublisherOptions publisher_options;
    publisher_options.security = options.poses_security;
    auto publisher = Publisher::Bind(options.poses, publisher_options);
    if (!publisher.ok()) return publisher.status();
    Status status = ServeSession(options, source, std::move(*publisher)).Run();
    // Told to stop while the map was being opened.
    if (status.code() == ErrorCode::kCancelled && CancelRequested()) return {};
    return status;
  } catch (const std::invalid_argument& error) {
    return {ErrorCode::kInvalidArgument, error.what()};
  } catch (const std::exception& error) {
    return {ErrorCode::kInternal, std::string("serve: ") + error.what()};
  }
}

}  // namespace panofix
