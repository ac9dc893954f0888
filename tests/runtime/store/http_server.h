#pragma once
// A plain HTTP server on loopback with one file, as good or as bad as a test wants it.

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/io/unique_fd.h"

namespace panofix {

struct HttpBehaviour {
  std::string content, etag = "\"one\"";
  int status = 200;            // of every answer, where not 200
  bool knows_ranges = true;    // else every answer is the whole file
  std::int64_t cut_after = 0;  // close each connection after so many bytes of content; 0 = never
  bool is_endless = false;     // states no length and sends for ever
  bool is_stalled = false;     // sends a header and nothing more
  std::string redirect_to;
};

class HttpServer {
 public:
  explicit HttpServer(HttpBehaviour behaviour);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;
  [[nodiscard]] std::string url() const;
  void Change(const HttpBehaviour& behaviour);
  // Heads of the requests so far.
  [[nodiscard]] std::vector<std::string> requests() const;

 private:
  void Serve();
  void Answer(int connection);
  bool Send(int connection, const std::string& text) const;

  mutable std::mutex mutex_;
  HttpBehaviour behaviour_;
  std::vector<std::string> requests_;
  UniqueFd socket_;
  int port_ = 0;
  std::atomic<bool> is_stopping_{false};
  std::thread thread_;
};

}  // namespace panofix
