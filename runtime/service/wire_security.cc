#include "runtime/service/wire_security.h"

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr std::size_t kSchemeChars = 6;  // tcp:// and ipc://

std::string HostOf(const std::string& endpoint) {
  const std::string rest = endpoint.substr(kSchemeChars);
  return rest.substr(0, rest.rfind(':'));
}

}  // namespace

bool IsLocal(const std::string& endpoint) {
  if (endpoint.starts_with("ipc://")) return true;
  const std::string host = HostOf(endpoint);
  return host.starts_with("127.") || host == "localhost" || host == "[::1]" || host == "lo";
}

Result<std::string> AddressToBind(const std::string& endpoint, const WireSecurity& security) {
  if (security.own || security.insecure_bind || IsLocal(endpoint)) return endpoint;
  const char* mend = "give --secret-key and the keys of those who may connect, or --insecure-bind";
  const std::string host = HostOf(endpoint);
  if (host != "*" && host != "0.0.0.0" && host != "[::]") {
    return Status(ErrorCode::kInvalidArgument,
                  endpoint + ": a socket without keys is for this machine alone; " + mend);
  }
  const std::string local = "tcp://127.0.0.1" + endpoint.substr(endpoint.rfind(':'));
  LogWarning(endpoint + ": without keys this is for this machine alone, " + local +
             "; for other machines " + mend);
  return local;
}

}  // namespace panofix
