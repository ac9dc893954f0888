#pragma once
// Signing: bundles for vehicles, and keys by keys. Throws Error.

#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "builder/ship/secret_key.h"
#include "common/sign/release_statement.h"

namespace panofix {

struct ReleaseOptions {
  std::int64_t created_s = 0;  // seconds since 1970
  // No release is made later than this: vehicles would take it as the time, and older clocks'
  // releases as expired, for good. The signer's clock and a day.
  std::int64_t latest_created_s = std::numeric_limits<std::int64_t>::max();
  double expires_days = 30;               // from then; vehicles refuse to install it later
  std::filesystem::path scores;           // of `validate --json`; may be empty
  std::vector<std::string> revoked_keys;  // ids that vehicles shall no longer trust
  void Check() const;                     // throws std::invalid_argument
};

// Checks every part of the bundle, then writes its manifest.json.minisig with what the options say
// as trusted comment. The bundle's id stays as it was; a bundle that is signed already gets the new
// signature in place of the old one.
ReleaseStatement SignBundle(const std::filesystem::path& bundle, const SecretKey& key,
                            const ReleaseOptions& options);

// The top-level numbers of a score table as JSON; kBadData where the table's fields are not there.
std::map<std::string, double> ReadScores(const std::filesystem::path& path);

// Writes `public_key`.minisig: whoever trusts `key` may trust that public key too.
void EndorseKey(const std::filesystem::path& public_key, const SecretKey& key);

// Makes a pair of files; refuses to replace any. The secret one is readable by its owner alone.
PublicKey WriteKeyPair(const std::filesystem::path& secret, const std::filesystem::path& public_key,
                       const std::string& password);

}  // namespace panofix
