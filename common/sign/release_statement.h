#pragma once
// What whoever signs a bundle says of it: the signature's trusted comment, one line of JSON. It is
// signed with the manifest but is no part of it, so that a bundle's id does not tell when it was
// released, and a release is renewed without a new bundle.

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace panofix {

struct ReleaseStatement {
  std::string name;        // of the bundle
  std::int64_t build = 0;  // of the bundle
  std::int64_t created_s = 0, expires_s = 0;
  std::vector<std::string> revoked_keys;  // ids that no longer count
  std::map<std::string, double> quality;  // figures of a score table
};

// At most kMaxTrustedCommentBytes, else kTooLarge. Equal statements give equal text.
[[nodiscard]] Result<std::string> FormatStatement(const ReleaseStatement& statement);
// kUntrusted where it is no such statement (a signature of something else); `name` is for messages.
[[nodiscard]] Result<ReleaseStatement> ParseStatement(const std::string& text,
                                                      const std::string& name);

}  // namespace panofix
