// Endpoint syntax.

#include "runtime/service/sockets.h"

namespace panofix {
namespace {

bool IsPort(const std::string& text) {
  if (text == "*") return true;
  if (text.empty() || text.size() > 5) return false;
  for (const char c : text) {
    if (c < '0' || c > '9') return false;
  }
  return std::stoi(text) <= 65535;
}

bool IsEndpoint(const std::string& endpoint) {
  constexpr std::size_t kSchemeChars = 6, kMaxChars = 1024;
  if (endpoint.size() > kMaxChars) return false;
  const std::string rest = endpoint.size() > kSchemeChars ? endpoint.substr(kSchemeChars) : "";
  if (endpoint.rfind("ipc://", 0) == 0) return !rest.empty();
  if (endpoint.rfind("tcp://", 0) != 0) return false;
  const std::size_t colon = rest.rfind(':');
  return colon != std::string::npos && colon > 0 && IsPort(rest.substr(colon + 1));
}

}  // namespace

Status CheckEndpoint(const std::string& option, const std::string& endpoint) {
  if (IsEndpoint(endpoint)) return {};
  return {ErrorCode::kInvalidArgument,
          option + " '" + endpoint + "': no endpoint; write tcp://HOST:PORT or ipc://PATH"};
}

}  // namespace panofix
