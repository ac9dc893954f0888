#include "builder/validate/signature_state.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "builder/validate/inspect.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/support/test_signer.h"

namespace panofix {
namespace {

class SignatureStateTest : public testing::Test {
 protected:
  SignatureStateTest() {
    CraftedBundle crafted = SmallBundle();
    crafted.manifest.build = 41;
    crafted.manifest.runtime_before = "7.0.0";
    crafted.manifest.vocabulary_release = "spring";
    crafted.manifest.provenance.options = R"({"num_views":2,"merge":true})";
    crafted.Write(bundle_);
  }
  void Sign(const std::function<void(ReleaseStatement*)>& change = {}) {
    SignFolder(bundle_, signer_, change);
  }
  [[nodiscard]] SignatureState StateWith(const KeyRing& ring) const {
    return SignatureStateOf(ValueOrThrow(ReadSignedManifest(bundle_, {})), ring);
  }
  [[nodiscard]] std::string TextOf(const SignatureState& state) const {
    return InspectText(*ValueOrThrow(MapBundle::Open(bundle_)), state);
  }
  void ExpectBad(const KeyRing& ring, const std::string& word) {
    const SignatureState state = StateWith(ring);
    EXPECT_EQ(state.kind, SignatureKind::kBad);
    EXPECT_FALSE(state.status.ok());
    EXPECT_FALSE(state.statement) << "nobody stands behind it";
    EXPECT_NE(SignatureText(state).find(word), std::string::npos) << SignatureText(state);
  }
  const TempFolder folder_;
  const std::filesystem::path bundle_ = folder_ / "b";
  const TestSigner signer_{1}, other_{2};
};

TEST_F(SignatureStateTest, WithoutASignatureItIsUnsigned) {
  EXPECT_EQ(StateWith({}).kind, SignatureKind::kUnsigned);
  EXPECT_TRUE(StateWith({}).status.ok());
  EXPECT_EQ(StateWith(signer_.ring()).kind, SignatureKind::kUnsigned);
  EXPECT_EQ(StateWith(signer_.ring()).status.code(), ErrorCode::kUntrusted);
  const auto json = nlohmann::json::parse(SignatureJson(StateWith({})));
  EXPECT_EQ(json["signature"]["state"], "unsigned");
  EXPECT_TRUE(json["signature"]["key"].is_null());
}

TEST_F(SignatureStateTest, OnlyItsOwnKeyVerifiesIt) {
  Sign();
  EXPECT_EQ(StateWith(signer_.ring()).kind, SignatureKind::kVerified);
  EXPECT_EQ(StateWith(signer_.ring()).key_id, signer_.id());
  EXPECT_EQ(StateWith({}).kind, SignatureKind::kNotVerified);
  EXPECT_EQ(StateWith({}).key_id, signer_.id());
  ExpectBad(other_.ring(), "not trusted");
}

TEST_F(SignatureStateTest, ASignatureOfAnotherReleaseIsBadWhoeverMadeIt) {
  Sign([](ReleaseStatement* s) { s->build = 40; });
  ExpectBad({}, "build 40");
  ExpectBad(signer_.ring(), "build 40");
}

TEST_F(SignatureStateTest, RubbishIsBad) {
  WriteText(bundle_ / kManifestSignatureName, "rubbish");
  ExpectBad({}, kManifestSignatureName);
  ExpectBad(signer_.ring(), "bad");
  Sign();
  // The signature's last line but one is signed as well: a later expiry is a forgery.
  std::string text = ReadText(bundle_ / kManifestSignatureName);
  const auto year = text.find("\"expires\":\"2") + std::string("\"expires\":\"2").size();
  text[year] = text[year] == '9' ? '8' : '9';
  WriteText(bundle_ / kManifestSignatureName, text);
  EXPECT_EQ(StateWith({}).kind, SignatureKind::kNotVerified) << "nobody can tell without a key";
  ExpectBad(signer_.ring(), "key " + signer_.id());
}

TEST_F(SignatureStateTest, InspectSaysAllOfTheRelease) {
  Sign([](ReleaseStatement* s) {
    s->created_s = 1800000000;
    s->revoked_keys = {"00000000000000AA"};
    s->quality = {{"share_fix", 0.5}};
  });
  const SignatureState state = StateWith(signer_.ring());
  const std::string text = TextOf(state);
  for (const std::string word :
       {"build 41", "panofix 0.1.0 and later, before 7.0.0", "verified, key ", "spring",
        "2027-01-15T08:00:00Z", "key 00000000000000AA", "share_fix 0.5", "num_views 2",
        "merge true"}) {
    EXPECT_NE(text.find(word), std::string::npos) << word << "\n" << text;
  }
  const auto bundle = ValueOrThrow(MapBundle::Open(bundle_));
  const auto json = nlohmann::json::parse(InspectJson(*bundle, state));
  EXPECT_EQ(json["signature"]["state"], "verified");
  EXPECT_EQ(json["signature"]["key"], signer_.id());
  EXPECT_EQ(json["signature"]["created"], "2027-01-15T08:00:00Z");
  EXPECT_EQ(json["signature"]["quality"]["share_fix"], 0.5);
  EXPECT_EQ(json["manifest"]["vocabulary_release"], "spring");
}

}  // namespace
}  // namespace panofix
