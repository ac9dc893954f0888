#include "builder/ship/release.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/read_file.h"
#include "common/io/unique_fd.h"
#include "common/map/bundle_files.h"
#include "common/sign/key_ring.h"
#include "common/sign/utc_time.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// A new file with these rights from its first moment on.
void WriteNewFile(const fs::path& path, const std::string& text, mode_t mode) {
  const UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
  if (!fd.valid()) {
    throw Error(errno == EEXIST ? ErrorCode::kInvalidArgument : ErrorCode::kIo,
                path.string() + ": cannot be made (" + std::strerror(errno) +
                    "); keys are never replaced: name a new file");
  }
  if (::write(fd.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()) ||
      ::fsync(fd.get()) != 0) {
    throw Error(ErrorCode::kIo, path.string() + ": writing failed (" + std::strerror(errno) +
                                    "); remove it, check the disk and run again");
  }
}

}  // namespace

void ReleaseOptions::Check() const {
  constexpr double kMostDays = 3660;
  if (!(expires_days > 0 && expires_days <= kMostDays))
    throw std::invalid_argument(
        Format("expires_days = %g; must be above 0 and at most %g", expires_days, kMostDays));
  if (created_s < 0) throw std::invalid_argument("created_s is before 1970");
  if (created_s > latest_created_s) {
    throw std::invalid_argument(
        "created " + FormatUtc(created_s) + " is more than a day ahead of this clock: vehicles " +
        "that install it hold what is signed with an earlier time for expired; set the clock or " +
        "--created right, or give --allow-future");
  }
}

std::map<std::string, double> ReadScores(const fs::path& path) {
  constexpr std::size_t kMaxBytes = std::size_t{64} << 20;
  std::map<std::string, double> scores;
  try {
    const auto json = nlohmann::json::parse(ValueOrThrow(ReadFileText(path, kMaxBytes)));
    if (!json.is_object()) throw std::invalid_argument("no object");
    // Another file's numbers would be signed as this map's quality.
    for (const char* field : {"num_frames", "num_fixes", "share_fix", "share_false_fixes"}) {
      if (!json.contains(field) || !json[field].is_number())
        throw std::invalid_argument(std::string("no number named ") + field);
    }
    for (const auto& [name, value] : json.items()) {
      if (value.is_number()) scores[name] = value.get<double>();
    }
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(
        ErrorCode::kBadData,
        path.string() + ": " + error.what() +
            "; name a score table that panofix-builder validate --json or score --json wrote");
  }
  return scores;
}

ReleaseStatement SignBundle(const fs::path& bundle, const SecretKey& key,
                            const ReleaseOptions& options) {
  options.Check();
  // What is signed is whole.
  const VerifiedBundle verified = ValueOrThrow(VerifyBundle(bundle, {}));
  const Manifest& manifest = verified.manifest.manifest;
  ReleaseStatement statement;
  statement.name = manifest.name;
  statement.build = manifest.build;
  statement.created_s = options.created_s;
  constexpr double kDay_s = 86400;
  statement.expires_s = options.created_s + std::llround(options.expires_days * kDay_s);
  for (const std::string& text : options.revoked_keys) {
    const auto id = KeyIdFromText(text);
    if (!id)
      throw Error(ErrorCode::kInvalidArgument, text + ": is no key id; give all its 16 hex digits");
    statement.revoked_keys.push_back(*id);
  }
  if (!options.scores.empty()) statement.quality = ReadScores(options.scores);
  const std::string comment = ValueOrThrow(FormatStatement(statement));
  const std::string signature = key.Sign(verified.manifest.text, comment);
  // Asked of ourselves before anybody else is.
  KeyRing own;
  own.trusted.push_back(key.public_key());
  ThrowIfError(CheckManifest(verified.manifest.text, signature, own, bundle.string()).status());
  ThrowIfError(WriteFileAtomically(bundle / kManifestSignatureName, signature));
  return statement;
}

void EndorseKey(const fs::path& public_key, const SecretKey& key) {
  constexpr std::size_t kMaxBytes = 4096;
  const std::string text = ValueOrThrow(ReadFileText(public_key, kMaxBytes));
  const PublicKey endorsed = ValueOrThrow(ParsePublicKey(text, public_key.string()));
  const std::string signature = key.Sign(text, kEndorsement + KeyIdText(endorsed.id));
  ThrowIfError(WriteFileAtomically(public_key.string() + kSignatureSuffix, signature));
}

PublicKey WriteKeyPair(const fs::path& secret, const fs::path& public_key,
                       const std::string& password) {
  const SecretKey key = SecretKey::Generate();
  if (fs::exists(public_key)) {
    throw Error(
        ErrorCode::kInvalidArgument,
        public_key.string() + ": is there already; keys are never replaced: name a new file");
  }
  WriteNewFile(secret, key.Format(password), S_IRUSR | S_IWUSR);
  WriteNewFile(public_key, FormatPublicKey(key.public_key()), 0644);
  return key.public_key();
}

}  // namespace panofix
