#pragma once
// What both sockets share. Includes zmq.hpp: for .cc files of this module only.

#include <string>
#include <zmq.hpp>

#include "common/base/status.h"
#include "runtime/service/wire_security.h"

namespace panofix::socket_support {

// What to do about a bind or connect that failed with `error_number`.
inline const char* Mend(int error_number) {
  switch (error_number) {
    case EADDRINUSE:
      return "end the program that holds the address, or choose another";
    case EACCES:
      return "choose a port above 1023, or a folder that you may write to";
    case EADDRNOTAVAIL:
    case ENODEV:
      return "name an address of this machine, or * for all of them";
    case ENOENT:
      return "make the folder first";
    case ENAMETOOLONG:
      return "choose a shorter path";
    default:
      return "write tcp://HOST:PORT or ipc://PATH";
  }
}

inline Status EndpointError(const std::string& endpoint, const char* verb,
                            const zmq::error_t& error) {
  const bool malformed = error.num() == EINVAL || error.num() == EPROTONOSUPPORT;
  return {malformed ? ErrorCode::kInvalidArgument : ErrorCode::kIo,
          endpoint + ": cannot " + verb + ": " + error.what() + "; " + Mend(error.num())};
}

// Peers that stop answering are dropped after this long; a healthy one answers in milliseconds.
constexpr int kHeartbeatInterval_ms = 1000, kHeartbeatTimeout_ms = 3000;

// Before bind or connect. A bound socket with keys needs a ZapGate in its context.
inline void SetSecurity(zmq::socket_t& socket, const WireSecurity& security, bool binds) {
  if (!security.own) return;
  socket.set(zmq::sockopt::curve_publickey, security.own->public_key);
  socket.set(zmq::sockopt::curve_secretkey, security.own->secret_key);
  if (binds) {
    socket.set(zmq::sockopt::curve_server, true);
    socket.set(zmq::sockopt::zap_domain, "panofix");
  } else {
    socket.set(zmq::sockopt::curve_serverkey, security.server_key);
  }
}

// Peers that connect and then say nothing are dropped after this long.
constexpr int kHandshakeTimeout_ms = 5000;

inline void SetHeartbeat(zmq::socket_t& socket) {
  socket.set(zmq::sockopt::heartbeat_ivl, kHeartbeatInterval_ms);
  socket.set(zmq::sockopt::heartbeat_timeout, kHeartbeatTimeout_ms);
  socket.set(zmq::sockopt::handshake_ivl, kHandshakeTimeout_ms);
  socket.set(zmq::sockopt::heartbeat_ttl, kHeartbeatTimeout_ms);
}

}  // namespace panofix::socket_support
