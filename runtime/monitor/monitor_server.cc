// The only includer of httplib.
#include "runtime/monitor/monitor_server.h"

#include <httplib.h>

#include <charconv>
#include <stdexcept>
#include <thread>

#include "common/base/log.h"
#include "runtime/monitor/live_json.h"
#include "runtime/monitor/live_page.h"
#include "runtime/monitor/prometheus_text.h"

namespace panofix {
namespace {

constexpr const char* kHost = "127.0.0.1";
constexpr const char* kPlain = "text/plain; charset=utf-8";
constexpr const char* kJson = "application/json";
constexpr std::size_t kThreads = 2, kMaxRequestBytes = 4096;

bool IsThisMachine(std::string host) {
  if (const auto colon = host.rfind(':'); colon != std::string::npos) host.resize(colon);
  return host == kHost || host == "localhost";
}

// Where a check fails, `fault` says why.
void AnswerCheck(const std::string& fault, httplib::Response* response) {
  response->status = fault.empty() ? 200 : 503;
  response->set_content(fault.empty() ? "ok\n" : fault + "\n", kPlain);
}

std::string HealthFault(const MonitorSnapshot& s, double hang_s) {
  if (!s.since_step_s) return "starting";
  return *s.since_step_s > hang_s ? Format("the loop has not turned for %.1f s", *s.since_step_s)
                                  : "";
}

std::string ReadyFault(const MonitorSnapshot& s, const MonitorServerOptions& options) {
  if (std::string fault = HealthFault(s, options.hang_s); !fault.empty()) return fault;
  if (!s.since_answer_s) return "no frame has been answered yet";
  return *s.since_answer_s > options.quiet_s
             ? Format("no frame has been answered for %.1f s", *s.since_answer_s)
             : "";
}

}  // namespace

struct MonitorServer::Impl {
  Impl(const MonitorServerOptions& server_options, const ServiceMonitor& service_monitor)
      : options(server_options), monitor(service_monitor) {}
  ~Impl() {
    server.stop();
    if (thread.joinable()) thread.join();
  }
  void AddRoutes();
  void AddPage();

  const MonitorServerOptions options;
  const ServiceMonitor& monitor;
  httplib::Server server;
  int port = 0;
  std::thread thread;
};

void MonitorServer::Impl::AddRoutes() {
  using httplib::Request, httplib::Response;
  server.set_pre_routing_handler([](const Request& request, Response& response) {
    response.set_header("X-Content-Type-Options", "nosniff");
    response.set_header("Cache-Control", "no-store");
    response.set_header("Content-Security-Policy",
                        "default-src 'self'; img-src 'self' data: blob:; style-src 'self' "
                        "'unsafe-inline'; frame-ancestors 'none'");
    if (IsThisMachine(request.get_header_value("Host"))) {
      return httplib::Server::HandlerResponse::Unhandled;
    }
    response.status = 403;
    response.set_content("ask for 127.0.0.1 or localhost\n", kPlain);
    return httplib::Server::HandlerResponse::Handled;
  });
  server.Get("/metrics", [this](const Request&, Response& response) {
    response.set_content(ToPrometheusText(monitor.Snapshot(), ReadProcessUse(), std::time(nullptr)),
                         "text/plain; version=0.0.4; charset=utf-8");
  });
  server.Get("/healthz", [this](const Request&, Response& response) {
    AnswerCheck(HealthFault(monitor.Snapshot(), options.hang_s), &response);
  });
  server.Get("/readyz", [this](const Request&, Response& response) {
    AnswerCheck(ReadyFault(monitor.Snapshot(), options), &response);
  });
  server.Get("/api/live", [this](const Request& request, Response& response) {
    const std::string text = request.get_param_value("after");
    std::int64_t after = 0;
    std::from_chars(text.data(), text.data() + text.size(), after);
    response.set_content(LiveJson(monitor.Snapshot(), monitor.TrailAfter(after)), kJson);
  });
  server.Get("/api/frame", [this](const Request&, Response& response) {
    const FramePicture picture = monitor.picture();
    const auto bytes = picture.preview ? picture.preview->Get() : picture.bytes;
    response.status = bytes.empty() ? 404 : 200;
    response.set_content(reinterpret_cast<const char*>(bytes.data()), bytes.size(),
                         picture.content_type.empty() ? kPlain : picture.content_type.c_str());
    response.set_header("X-Timestamp-Ns", std::to_string(picture.timestamp_ns));
  });
  server.Get("/api/sight", [this](const Request&, Response& response) {
    response.set_content(SightJson(monitor.picture()), kJson);
  });
  server.Get("/api/route", [this](const Request&, Response& response) {
    response.set_content(RouteJson(monitor.map()), kJson);
  });
}

void MonitorServer::Impl::AddPage() {
  const auto give = [](const std::string& name) {
    return [name](const httplib::Request&, httplib::Response& response) {
      const PageFile file = FindPageFile(name).value();
      response.set_content(file.text.data(), file.text.size(), file.content_type);
    };
  };
  server.Get("/", give("index.html"));
  server.Get("/live.css", give("live.css"));
  server.Get("/live.js", give("live.js"));
  if (!server.set_mount_point("/leaflet", LeafletFolder().string())) {
    LogWarning("the live page has no map: install libjs-leaflet");
  }
}

MonitorServer::MonitorServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MonitorServer::~MonitorServer() = default;
int MonitorServer::port() const { return impl_->port; }

Result<std::unique_ptr<MonitorServer>> MonitorServer::Start(const MonitorServerOptions& options,
                                                            const ServiceMonitor& monitor) {
  auto impl = std::make_unique<Impl>(options, monitor);
  httplib::Server& server = impl->server;
  server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  server.set_payload_max_length(kMaxRequestBytes);
  server.set_read_timeout(std::chrono::seconds(2));
  server.set_write_timeout(std::chrono::seconds(2));
  server.set_keep_alive_max_count(1);  // a watcher that lingers would keep a thread
  // Without SO_REUSEPORT, the library's default: another service's port would be shared silently.
  server.set_socket_options([](socket_t socket) {
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
  });
  impl->AddRoutes();
  impl->AddPage();
  impl->port = options.port != 0 && server.bind_to_port(kHost, options.port)
                   ? options.port
                   : (options.port == 0 ? server.bind_to_any_port(kHost) : -1);
  if (impl->port <= 0) {
    return Status(ErrorCode::kIo,
                  Format("http: cannot listen on %s:%d; end the program that holds the port, or "
                         "choose another",
                         kHost, options.port));
  }
  impl->thread = std::thread([&server] { server.listen_after_bind(); });
  constexpr int kPatience_ms = 5000;  // only where the system refuses a thread its turn
  for (int i = 0; i < kPatience_ms && !server.is_running(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return std::unique_ptr<MonitorServer>(new MonitorServer(std::move(impl)));
}

void MonitorServerOptions::Check() const {
  if (port < 0 || port > 65535) throw std::invalid_argument("http port must be 0 to 65535");
}

}  // namespace panofix
