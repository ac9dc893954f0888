#include "tests/runtime/store/http_server.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>

namespace panofix {

HttpServer::HttpServer(HttpBehaviour behaviour) : behaviour_(std::move(behaviour)) {
  socket_ = UniqueFd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  struct sockaddr_in address {};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  auto* plain = reinterpret_cast<struct sockaddr*>(&address);
  EXPECT_EQ(::bind(socket_.get(), plain, size), 0);
  EXPECT_EQ(::listen(socket_.get(), 8), 0);
  EXPECT_EQ(::getsockname(socket_.get(), plain, &size), 0);
  port_ = ntohs(address.sin_port);
  thread_ = std::thread([this] { Serve(); });
}

HttpServer::~HttpServer() {
  is_stopping_ = true;
  thread_.join();
}

std::string HttpServer::url() const {
  return "http://127.0.0.1:" + std::to_string(port_) + "/city.pfb";
}

void HttpServer::Change(const HttpBehaviour& behaviour) {
  const std::lock_guard lock(mutex_);
  behaviour_ = behaviour;
}

std::vector<std::string> HttpServer::requests() const {
  const std::lock_guard lock(mutex_);
  return requests_;
}

void HttpServer::Serve() {
  while (!is_stopping_) {
    struct pollfd waiting {
      socket_.get(), POLLIN, 0
    };
    if (::poll(&waiting, 1, 20) <= 0) continue;
    const UniqueFd connection(::accept4(socket_.get(), nullptr, nullptr, SOCK_CLOEXEC));
    if (connection.valid()) Answer(connection.get());
  }
}

bool HttpServer::Send(int connection, const std::string& text) const {
  for (std::size_t at = 0; at < text.size();) {
    const ssize_t sent = ::send(connection, text.data() + at, text.size() - at, MSG_NOSIGNAL);
    if (sent <= 0) return false;
    at += static_cast<std::size_t>(sent);
  }
  return true;
}

void HttpServer::Answer(int connection) {
  std::string head;
  char buffer[4096];
  while (head.find("\r\n\r\n") == std::string::npos) {
    const ssize_t got = ::recv(connection, buffer, sizeof buffer, 0);
    if (got <= 0) return;
    head.append(buffer, static_cast<std::size_t>(got));
  }
  HttpBehaviour b;
  {
    const std::lock_guard lock(mutex_);
    requests_.push_back(head);
    b = behaviour_;
  }
  if (!b.redirect_to.empty()) {
    Send(connection, "HTTP/1.1 302 Found\r\nLocation: " + b.redirect_to +
                         "\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    return;
  }
  if (b.status != 200) {
    Send(connection, "HTTP/1.1 " + std::to_string(b.status) +
                         " No\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    return;
  }
  std::string headers = "Connection: close\r\n";
  if (!b.etag.empty()) headers += "ETag: " + b.etag + "\r\n";
  if (b.is_endless || b.is_stalled) {
    Send(connection, "HTTP/1.1 200 OK\r\n" + headers + "\r\n");
    const std::string block(std::size_t{1} << 16, 'x');
    while (!is_stopping_ && (b.is_stalled || Send(connection, block))) {
      struct pollfd waiting {
        connection, POLLIN, 0
      };
      if (b.is_stalled && ::poll(&waiting, 1, 20) > 0) return;  // the other side is gone
    }
    return;
  }
  std::size_t begin = 0;
  const auto range = head.find("Range: bytes=");
  const auto condition = head.find("If-Range: ");
  const bool is_same =
      condition == std::string::npos || head.compare(condition + 10, b.etag.size(), b.etag) == 0;
  if (b.knows_ranges && is_same && range != std::string::npos)
    begin = std::stoul(head.substr(range + 13));
  if (begin >= b.content.size() && begin > 0) {
    Send(connection, "HTTP/1.1 416 No\r\nContent-Length: 0\r\n" + headers + "\r\n");
    return;
  }
  std::string body = b.content.substr(begin);
  headers += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  if (begin > 0) {
    headers += "Content-Range: bytes " + std::to_string(begin) + "-" +
               std::to_string(b.content.size() - 1) + "/" + std::to_string(b.content.size()) +
               "\r\n";
  }
  if (b.cut_after > 0) body = body.substr(0, static_cast<std::size_t>(b.cut_after));
  Send(connection,
       (begin > 0 ? "HTTP/1.1 206 Partial\r\n" : "HTTP/1.1 200 OK\r\n") + headers + "\r\n" + body);
}

}  // namespace panofix
