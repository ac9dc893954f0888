#pragma once
// Whose signature a bundle carries, as far as can be told: for people who look at it. What opens a
// bundle asks common/map/bundle_files.h instead.

#include <optional>
#include <string>

#include "common/map/bundle_files.h"

namespace panofix {

enum class SignatureKind {
  kUnsigned,
  kNotVerified,  // no key was given to verify with
  kVerified,
  kBad,
};
[[nodiscard]] const char* SignatureKindName(SignatureKind kind);

struct SignatureState {
  SignatureKind kind = SignatureKind::kUnsigned;
  std::string key_id;  // that it names; empty where none can be read
  Status status;       // why a reader with the given keys would refuse it
  // What the signature says, unless it is bad; anybody may have written what is not verified.
  std::optional<ReleaseStatement> statement;
};

// Without keys in `ring` a signature is read and compared with the manifest: what is then no
// signature, or one of another release, is bad whoever made it.
// `name` is the manifest's, for messages.
[[nodiscard]] SignatureState SignatureStateOf(const SignedManifest& bundle, const KeyRing& ring,
                                              const std::string& name = kManifestName);

}  // namespace panofix
