#include "builder/validate/signature_state.h"

#include "common/base/log.h"

namespace panofix {
namespace {

// What can be said without a key.
SignatureState ReadWithoutKey(const SignedManifest& bundle, const std::string& manifest_name) {
  const std::string name = manifest_name + kSignatureSuffix;
  SignatureState state;
  state.kind = SignatureKind::kBad;
  const auto signature = ParseSignature(bundle.signature_text, name);
  if (!signature.ok()) {
    state.status = signature.status();
    return state;
  }
  state.key_id = KeyIdText(signature->key_id);
  auto statement = ParseStatement(signature->trusted_comment, name);
  if (!statement.ok()) {
    state.status = statement.status();
    return state;
  }
  const Manifest& manifest = bundle.manifest;
  if (statement->name != manifest.name || statement->build != manifest.build) {
    state.status = {ErrorCode::kUntrusted,
                    Format("%s: is for build %lld of '%s'; sign the bundle again", name.c_str(),
                           static_cast<long long>(statement->build), statement->name.c_str())};
    return state;
  }
  state.statement = std::move(*statement);
  state.kind = SignatureKind::kNotVerified;
  return state;
}

}  // namespace

const char* SignatureKindName(SignatureKind kind) {
  switch (kind) {
    case SignatureKind::kUnsigned:
      return "unsigned";
    case SignatureKind::kNotVerified:
      return "not verified";
    case SignatureKind::kVerified:
      return "verified";
    case SignatureKind::kBad:
      return "bad";
  }
  return "bad";
}

SignatureState SignatureStateOf(const SignedManifest& bundle, const KeyRing& ring,
                                const std::string& name) {
  const bool is_unsigned = bundle.signature_text.empty();
  SignatureState state = is_unsigned ? SignatureState{} : ReadWithoutKey(bundle, name);
  if (ring.empty()) return state;
  state.status = CheckManifest(bundle.text, bundle.signature_text, ring, name).status();
  if (is_unsigned) return state;
  state.kind = state.status.ok() ? SignatureKind::kVerified : SignatureKind::kBad;
  if (state.kind == SignatureKind::kBad) state.statement.reset();
  return state;
}

}  // namespace panofix
