#include "runtime/app/wire_options.h"

#include <CLI/CLI.hpp>

namespace panofix {
namespace {

Status ReadOwn(const WireKeyFiles& files, const char* because_of, WireSecurity* security) {
  if (files.secret_key.empty()) {
    return {ErrorCode::kInvalidArgument,
            std::string(because_of) + " needs --secret-key too; make one with wire-key"};
  }
  auto own = ReadWireKeys(files.secret_key);
  if (!own.ok()) return own.status();
  security->own = std::move(*own);
  return {};
}

}  // namespace

void AddSecretKeyOption(CLI::App* command, WireKeyFiles* files) {
  command->add_option("--secret-key", files->secret_key,
                      "our own secret key: connections are encrypted (see wire-key)");
}

void AddBoundSocketOptions(CLI::App* command, WireKeyFiles* files, const char* who) {
  command->add_option(
      "--client-key", files->client_keys,
      std::string("public key of ") + who + "; may be repeated, others are refused");
  command->add_flag("--insecure-bind", files->insecure_bind,
                    "without keys, listen to other machines all the same");
}

Result<WireSecurity> BoundSecurity(const WireKeyFiles& files) {
  WireSecurity security;
  security.insecure_bind = files.insecure_bind;
  if (files.client_keys.empty()) return security;
  if (Status status = ReadOwn(files, "--client-key", &security); !status.ok()) return status;
  for (const auto& path : files.client_keys) {
    auto key = ReadWirePublicKey(path);
    if (!key.ok()) return key.status();
    security.client_keys.push_back(std::move(*key));
  }
  return security;
}

Result<WireSecurity> ConnectSecurity(const WireKeyFiles& files, const char* option) {
  WireSecurity security;
  security.insecure_bind = files.insecure_bind;
  if (files.server_key.empty()) return security;
  if (Status status = ReadOwn(files, option, &security); !status.ok()) return status;
  auto key = ReadWirePublicKey(files.server_key);
  if (!key.ok()) return key.status();
  security.server_key = *key;
  // Where the socket binds instead ('*'), that key is the one that may connect.
  security.client_keys = {std::move(*key)};
  return security;
}

}  // namespace panofix
