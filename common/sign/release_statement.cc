#include "common/sign/release_statement.h"

#include <nlohmann/json.hpp>
#include <stdexcept>

#include "common/base/log.h"
#include "common/sign/minisign.h"
#include "common/sign/utc_time.h"

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kKind[] = "bundle release 1";

std::int64_t TimeFrom(const Json& j, const char* key) {
  const auto time_s = ParseUtc(j.at(key).get<std::string>());
  if (!time_s)
    throw std::invalid_argument(std::string(key) + " is no time such as 2026-11-22T09:30:00Z");
  return *time_s;
}

ReleaseStatement StatementFrom(const Json& j) {
  ReleaseStatement s;
  if (j.at("panofix") != kKind) throw std::invalid_argument("not of kind 'bundle release 1'");
  j.at("name").get_to(s.name);
  j.at("build").get_to(s.build);
  s.created_s = TimeFrom(j, "created"), s.expires_s = TimeFrom(j, "expires");
  if (s.expires_s <= s.created_s) throw std::invalid_argument("it expires before it was made");
  if (j.contains("revoked_keys")) j.at("revoked_keys").get_to(s.revoked_keys);
  if (j.contains("quality")) j.at("quality").get_to(s.quality);
  for (const std::string& id : s.revoked_keys) {
    if (id.size() != 16 || id.find_first_not_of("0123456789ABCDEF") != std::string::npos)
      throw std::invalid_argument("a revoked key's id is not 16 hex digits");
  }
  return s;
}

}  // namespace

Result<std::string> FormatStatement(const ReleaseStatement& s) {
  Json j = {{"panofix", kKind},
            {"name", s.name},
            {"build", s.build},
            {"created", FormatUtc(s.created_s)},
            {"expires", FormatUtc(s.expires_s)}};
  if (!s.revoked_keys.empty()) j["revoked_keys"] = s.revoked_keys;
  if (!s.quality.empty()) j["quality"] = s.quality;
  std::string text = j.dump(-1, ' ', true);
  if (text.size() > kMaxTrustedCommentBytes) {
    return Status(ErrorCode::kTooLarge,
                  Format("release statement: %zu bytes; a signature carries at most %zu: give "
                         "fewer scores or revoked keys",
                         text.size(), kMaxTrustedCommentBytes));
  }
  return text;
}

Result<ReleaseStatement> ParseStatement(const std::string& text, const std::string& name) {
  try {
    return StatementFrom(Json::parse(text));
  } catch (const std::exception& error) {
    return Status(ErrorCode::kUntrusted, name +
                                             ": the signature's trusted comment is no release "
                                             "statement (" +
                                             error.what() +
                                             "); sign the bundle with panofix-builder sign");
  }
}

}  // namespace panofix
