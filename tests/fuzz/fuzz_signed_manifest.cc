// A manifest with its signature, and every other small text of the trust chain: nothing but what
// was signed is accepted.

#include <cstdlib>

#include "common/map/bundle_files.h"
#include "common/package/delta_index.h"
#include "common/sign/key_ring.h"
#include "common/sign/utc_time.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/test_signer.h"

namespace panofix {
namespace {

// Between the manifest and the signature in an input.
constexpr char kDivider[] = "\n--8<--\n";

struct Signed {
  TestSigner signer{1};
  Manifest manifest = SmallBundle().manifest;
  std::string text, comment, signature;
  Signed() {
    manifest.parts = {{"graph.h5", 10, std::string(64, 'a')},
                      {"tiles/1.h5", 20, std::string(64, 'b')}};
    text = ToJson(manifest);
    ReleaseStatement statement = StatementFor(manifest);
    statement.revoked_keys = {"0123456789ABCDEF"};
    statement.quality = {{"share_fix", 0.9}};
    comment = FormatStatement(statement).value();
    signature = signer.Sign(text, comment);
  }
};

const Signed& Good() {
  static const Signed good;
  return good;
}

void UseManifest(const std::string& text) {
  const auto manifest = ParseManifest(text, "m");
  if (!manifest.ok()) return;
  for (const BundlePart& part : manifest->parts) {
    const std::filesystem::path path = std::filesystem::path("/b") / part.path;
    if (!path.lexically_normal().string().starts_with("/b/")) std::abort();
  }
  static_cast<void>(ToJson(*manifest));
}

}  // namespace

FuzzCorpus SeedCorpus() {
  const Signed& good = Good();
  FuzzCorpus corpus;
  corpus.inputs = {
      good.text + kDivider + good.signature,
      good.text + kDivider + good.signer.Sign(good.text, good.comment, false),
      good.text,
      good.comment,
      FormatPublicKey(good.signer.key()),
      ToJson(DeltaIndex{"", std::string(64, 'a'), {{std::string(64, 'b'), std::string(64, 'c')}}})};
  corpus.words = {"\"parts\":[",
                  "../",
                  "\"path\":\"/etc\"",
                  "1e999",
                  "-1",
                  "null",
                  "\n",
                  "untrusted comment: ",
                  "trusted comment: ",
                  kDivider,
                  "{",
                  "}",
                  "[",
                  "]",
                  "\\u0000",
                  "18446744073709551616",
                  "RUQ",
                  "2027-02-31T00:00:00Z"};
  return corpus;
}

}  // namespace panofix

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace panofix;
  const std::string input(reinterpret_cast<const char*>(data), size);
  UseManifest(input);
  static_cast<void>(ParseStatement(input, "m"));
  static_cast<void>(ParseDeltaIndex(input, "d"));
  static_cast<void>(ParsePublicKey(input, "k"));
  static_cast<void>(ParseUtc(input));
  const auto divider = input.find(kDivider);
  if (divider == std::string::npos) return 0;
  const std::string text = input.substr(0, divider), signature = input.substr(divider + 8);
  const auto checked = CheckManifest(text, signature, Good().signer.ring(), "m");
  if (!checked.ok()) return checked.status().message().empty() ? (std::abort(), 0) : 0;
  // Accepted: then it is what was signed, to the last byte, and the statement too. The untrusted
  // comment alone is anybody's.
  if (text != Good().text ||
      FormatStatement(checked->release->statement).value() != Good().comment) {
    std::abort();
  }
  return 0;
}
