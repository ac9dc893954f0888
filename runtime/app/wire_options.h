#pragma once
// Command-line options that say who may be at the other end of a socket.

#include <filesystem>
#include <vector>

#include "runtime/service/wire_security.h"

namespace CLI {
class App;
}

namespace panofix {

struct WireKeyFiles {
  std::filesystem::path secret_key;                // our own
  std::filesystem::path server_key;                // of the side that we connect to
  std::vector<std::filesystem::path> client_keys;  // of those that connect to us
  bool insecure_bind = false;
};

// --secret-key.
void AddSecretKeyOption(CLI::App* command, WireKeyFiles* files);
// --client-key and --insecure-bind.
void AddBoundSocketOptions(CLI::App* command, WireKeyFiles* files, const char* who);
// Reads the files. Without --client-key a bound socket is plain, without a server key a connecting
// one. kInvalidArgument where a key lacks its counterpart.
[[nodiscard]] Result<WireSecurity> BoundSecurity(const WireKeyFiles& files);
[[nodiscard]] Result<WireSecurity> ConnectSecurity(const WireKeyFiles& files, const char* option);

}  // namespace panofix
