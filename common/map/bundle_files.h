#pragma once
// A bundle's files, checked before anything is made of them: signature, sizes, hashes. No byte
// reaches the HDF5 library here.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/io/unique_fd.h"
#include "common/map/manifest.h"
#include "common/sign/key_ring.h"
#include "common/sign/release_statement.h"

namespace panofix {

// Whose signature was verified, and what it says.
struct BundleRelease {
  std::string key_id;
  ReleaseStatement statement;
};

struct SignedManifest {
  Manifest manifest;
  std::string id;                        // SHA-256 of `text`
  std::string text, signature_text;      // the files' bytes; no signature: empty
  std::optional<BundleRelease> release;  // absent where no key was given to verify with
};

// A manifest and its signature, as bytes. With keys in `ring` the signature is verified before the
// manifest is parsed: kUntrusted (none, wrong, unknown key, another bundle's statement),
// kKeyRevoked. Without, it is not looked at. `name` is for messages.
[[nodiscard]] Result<SignedManifest> CheckManifest(std::string text, std::string signature_text,
                                                   const KeyRing& ring, const std::string& name);

// The same from a bundle's folder; its hash file must match too (kChecksumMismatch).
[[nodiscard]] Result<SignedManifest> ReadSignedManifest(const std::filesystem::path& folder,
                                                        const KeyRing& ring);

struct VerifiedPart {
  BundlePart part;
  UniqueFd fd;  // of the very file that was hashed
};

struct VerifiedBundle {
  SignedManifest manifest;
  std::vector<VerifiedPart> parts;  // in the manifest's order
};

// All of a bundle's files, open and right. kNotFound, kChecksumMismatch (size or SHA-256), and what
// ReadSignedManifest says. Holds one descriptor a part: raises this process's own limit as needed.
[[nodiscard]] Result<VerifiedBundle> VerifyBundle(const std::filesystem::path& folder,
                                                  const KeyRing& ring);

// The part of `folder`, open, with its size checked: kNotFound, kChecksumMismatch.
[[nodiscard]] Result<UniqueFd> OpenPart(const std::filesystem::path& folder,
                                        const BundlePart& part);

// The part's bytes in memory of our own, compared with its SHA-256 (kChecksumMismatch).
[[nodiscard]] Result<UniqueFd> CopyVerifiedPart(int fd, const BundlePart& part,
                                                const std::string& name);

// All parts of a manifest, open, their sizes checked and their bytes not yet looked at; see
// OpenPart. Raises this process's own limit of open files as needed.
[[nodiscard]] Result<std::vector<UniqueFd>> OpenParts(const std::filesystem::path& folder,
                                                      const std::vector<BundlePart>& parts);

}  // namespace panofix
