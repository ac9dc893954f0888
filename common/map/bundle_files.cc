#include "common/map/bundle_files.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "common/base/log.h"
#include "common/io/read_file.h"
#include "common/io/sealed_copy.h"
#include "common/io/sha256.h"
#include "common/map/map_arrays.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

using map_internal::kMend;

// A soft limit of 1024 open files is common; the hard one is far higher. What else is open is not
// known here: two maps may be, and many a socket. Where it is refused the limit stays.
void AllowOpenFiles() {
  struct rlimit limit {};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == limit.rlim_max) return;
  limit.rlim_cur = limit.rlim_max;
  static_cast<void>(::setrlimit(RLIMIT_NOFILE, &limit));
}

Result<BundleRelease> VerifyRelease(const std::string& text, const std::string& signature_text,
                                    const KeyRing& ring, const std::string& name) {
  if (signature_text.empty()) {
    // Bundles of an older format were never signed: the format is what is wrong with them.
    const auto parsed = ParseManifest(text, name);
    if (parsed.status().code() == ErrorCode::kUnsupportedVersion) return parsed.status();
    return Status(ErrorCode::kUntrusted,
                  name + ": is not signed; sign the bundle with panofix-builder sign");
  }
  const auto signature = VerifyWith(ring, text, signature_text, name);
  if (!signature.ok()) return signature.status();
  auto statement = ParseStatement(signature->trusted_comment, name);
  if (!statement.ok()) return statement.status();
  return BundleRelease{KeyIdText(signature->key_id), std::move(*statement)};
}

}  // namespace

Result<SignedManifest> CheckManifest(std::string text, std::string signature_text,
                                     const KeyRing& ring, const std::string& name) {
  SignedManifest out;
  if (!ring.empty()) {
    auto release = VerifyRelease(text, signature_text, ring, name);
    if (!release.ok()) return release.status();
    out.release = std::move(*release);
  }
  auto manifest = ParseManifest(text, name);
  if (!manifest.ok()) return manifest.status();
  if (out.release && (out.release->statement.name != manifest->name ||
                      out.release->statement.build != manifest->build)) {
    return Status(
        ErrorCode::kUntrusted,
        Format("%s: is build %lld of '%s', its signature is for build %lld of '%s'; sign "
               "it again",
               name.c_str(), static_cast<long long>(manifest->build), manifest->name.c_str(),
               static_cast<long long>(out.release->statement.build),
               out.release->statement.name.c_str()));
  }
  out.manifest = std::move(*manifest);
  out.id = Sha256Hex(text);
  out.text = std::move(text), out.signature_text = std::move(signature_text);
  return out;
}

Result<SignedManifest> ReadSignedManifest(const fs::path& folder, const KeyRing& ring) {
  const std::string name = (folder / kManifestName).string();
  if (!fs::is_directory(folder)) {
    return Status(ErrorCode::kNotFound, folder.string() +
                                            ": no such bundle folder; build one with "
                                            "panofix-builder build");
  }
  auto text = ReadFileText(folder / kManifestName, kMaxManifestBytes);
  if (!text.ok()) return text.status();
  std::string signature_text;
  if (fs::exists(folder / kManifestSignatureName)) {
    auto read = ReadFileText(folder / kManifestSignatureName, kMaxSignatureBytes);
    if (!read.ok()) return read.status();
    signature_text = std::move(*read);
  }
  constexpr std::size_t kMaxHashBytes = 4096;
  const auto hash = ReadFileText(folder / kManifestHashName, kMaxHashBytes);
  if (!hash.ok()) return hash.status();
  if (hash->substr(0, 64) != Sha256Hex(*text)) {
    // A newer format may hash another way: say so first.
    const auto parsed = ParseManifest(*text, name);
    if (!parsed.ok() && parsed.status().code() == ErrorCode::kUnsupportedVersion)
      return parsed.status();
    return Status(ErrorCode::kChecksumMismatch,
                  name + ": its SHA-256 is not the one in " + kManifestHashName + kMend);
  }
  return CheckManifest(std::move(*text), std::move(signature_text), ring, name);
}

Result<UniqueFd> OpenPart(const fs::path& folder, const BundlePart& part) {
  const std::string name = (folder / part.path).string();
  UniqueFd fd(::open(name.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!fd.valid() && errno == EMFILE) {
    return Status(ErrorCode::kIo, name +
                                      ": too many open files; raise this process's limit "
                                      "(ulimit -n, LimitNOFILE=)");
  }
  struct stat info {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return Status(ErrorCode::kNotFound, name + ": cannot be read" + kMend);
  }
  if (static_cast<std::uint64_t>(info.st_size) != part.num_bytes) {
    return Status(ErrorCode::kChecksumMismatch,
                  Format("%s: %lld bytes, the manifest says %llu%s", name.c_str(),
                         static_cast<long long>(info.st_size),
                         static_cast<unsigned long long>(part.num_bytes), kMend));
  }
  return fd;
}

Result<UniqueFd> CopyVerifiedPart(int fd, const BundlePart& part, const std::string& name) {
  auto copy = CopyToMemory(fd, part.num_bytes, name);
  if (!copy.ok()) return copy.status();
  if (copy->sha256 != part.sha256) {
    return Status(ErrorCode::kChecksumMismatch,
                  name + ": its SHA-256 is not the manifest's" + kMend);
  }
  return std::move(copy->fd);
}

Result<std::vector<UniqueFd>> OpenParts(const fs::path& folder,
                                        const std::vector<BundlePart>& parts) {
  AllowOpenFiles();
  std::vector<UniqueFd> descriptors;
  for (const BundlePart& part : parts) {
    auto fd = OpenPart(folder, part);
    if (!fd.ok()) return fd.status();
    descriptors.push_back(std::move(*fd));
  }
  return descriptors;
}

Result<VerifiedBundle> VerifyBundle(const fs::path& folder, const KeyRing& ring) {
  auto manifest = ReadSignedManifest(folder, ring);
  if (!manifest.ok()) return manifest.status();
  VerifiedBundle bundle;
  bundle.manifest = std::move(*manifest);
  AllowOpenFiles();
  for (const BundlePart& part : bundle.manifest.manifest.parts) {
    auto fd = OpenPart(folder, part);
    if (!fd.ok()) return fd.status();
    const std::string name = (folder / part.path).string();
    const auto hash = Sha256OfDescriptor(fd->get(), name);
    if (!hash.ok()) return hash.status();
    if (*hash != part.sha256) {
      return Status(ErrorCode::kChecksumMismatch,
                    name + ": its SHA-256 is not the manifest's" + kMend);
    }
    bundle.parts.push_back({part, std::move(*fd)});
  }
  return bundle;
}

}  // namespace panofix
