#pragma once
// Who may be at the other end of a socket, and who can listen on the way.

#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "runtime/service/wire_keys.h"

namespace panofix {

// Without `own` the socket is plain: neither encrypted nor authenticated.
struct WireSecurity {
  std::optional<WireKeyPair> own;
  std::string server_key;                // of the bound side, for a socket that connects
  std::vector<std::string> client_keys;  // who may connect to a bound socket: these and no others
  bool insecure_bind = false;            // a plain socket may be bound for other machines
};

// The address that a socket asked to bind to `endpoint` really gets. A plain one is for this
// machine alone: "tcp://*:PORT" becomes 127.0.0.1, with a warning, and any other address that is
// not loopback is refused (kInvalidArgument), unless insecure_bind says otherwise.
[[nodiscard]] Result<std::string> AddressToBind(const std::string& endpoint,
                                                const WireSecurity& security);
// Whether the endpoint cannot be reached from another machine: ipc, or a loopback address.
[[nodiscard]] bool IsLocal(const std::string& endpoint);

}  // namespace panofix
