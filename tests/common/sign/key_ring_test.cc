#include "common/sign/key_ring.h"

#include <gtest/gtest.h>

#include "tests/common/io/temp_folder.h"
#include "tests/support/test_signer.h"

namespace panofix {
namespace {

const TestSigner kOne(1), kTwo(2);

TEST(KeyRing, TakesTrustedKeysOnly) {
  const KeyRing ring = kOne.ring();
  const auto good = VerifyWith(ring, "m", kOne.Sign("m", "c"), "file");
  ASSERT_TRUE(good.ok()) << good.status().message();
  EXPECT_EQ(good->trusted_comment, "c");
  EXPECT_TRUE(VerifyWith(ring, "m", kOne.Sign("m", "c", false), "file").ok());
  const Status other = VerifyWith(ring, "m", kTwo.Sign("m", "c"), "file").status();
  EXPECT_EQ(other.code(), ErrorCode::kUntrusted);
  EXPECT_NE(other.message().find(kTwo.id()), std::string::npos) << other.message();
  EXPECT_EQ(VerifyWith(ring, "n", kOne.Sign("m", "c"), "file").status().code(),
            ErrorCode::kUntrusted);
  EXPECT_EQ(VerifyWith(ring, "m", "nonsense", "file").status().code(), ErrorCode::kBadData);
  EXPECT_EQ(VerifyWith({}, "m", kOne.Sign("m", "c"), "file").status().code(),
            ErrorCode::kUntrusted);
}

TEST(KeyRing, RevokedKeysCountNoMore) {
  KeyRing ring = kOne.ring();
  ring.revoked = {kOne.id()};
  EXPECT_EQ(VerifyWith(ring, "m", kOne.Sign("m", "c"), "file").status().code(),
            ErrorCode::kKeyRevoked);
}

TEST(KeyRing, AKeyBringsInTheNext) {
  const std::string text = FormatPublicKey(kTwo.key());
  const auto key = VerifyEndorsement(kOne.ring(), text, kOne.Endorse(kTwo.key()), "two.pub");
  ASSERT_TRUE(key.ok()) << key.status().message();
  EXPECT_EQ(*key, kTwo.key());
}

TEST(KeyRing, NotEverySignatureIsAnEndorsement) {
  const std::string text = FormatPublicKey(kTwo.key());
  const auto code = [&](const KeyRing& ring, const std::string& signature) {
    return VerifyEndorsement(ring, text, signature, "two.pub").status().code();
  };
  // Signed, but not for that; for another key; by itself; by a revoked key; a revoked key.
  EXPECT_EQ(code(kOne.ring(), kOne.Sign(text, "timestamp:1 file:two.pub")), ErrorCode::kUntrusted);
  EXPECT_EQ(code(kOne.ring(), kOne.Sign(text, kEndorsement + kOne.id())), ErrorCode::kUntrusted);
  EXPECT_EQ(code(kOne.ring(), kTwo.Endorse(kTwo.key())), ErrorCode::kUntrusted);
  KeyRing ring = kOne.ring();
  ring.revoked = {kOne.id()};
  EXPECT_EQ(code(ring, kOne.Endorse(kTwo.key())), ErrorCode::kKeyRevoked);
  ring.revoked = {kTwo.id()};
  EXPECT_EQ(code(ring, kOne.Endorse(kTwo.key())), ErrorCode::kKeyRevoked);
  // A key that takes the id of one that is trusted.
  PublicKey twin = kTwo.key();
  twin.id = kOne.key().id;
  EXPECT_EQ(VerifyEndorsement(kOne.ring(), FormatPublicKey(twin), kOne.Endorse(twin), "t")
                .status()
                .code(),
            ErrorCode::kUntrusted);
}

TEST(KeyRing, IsReadFromFiles) {
  const TempFolder folder;
  WriteText(folder / "one.pub", FormatPublicKey(kOne.key()));
  WriteText(folder / "two.pub", FormatPublicKey(kTwo.key()));
  WriteText(folder / "bad.pub", "no key");
  const auto ring = ReadKeyRing({folder / "one.pub", folder / "two.pub"});
  ASSERT_TRUE(ring.ok());
  EXPECT_EQ(ring->trusted, (std::vector<PublicKey>{kOne.key(), kTwo.key()}));
  EXPECT_TRUE(ReadKeyRing({}).value().empty());
  EXPECT_EQ(ReadKeyRing({folder / "none.pub"}).status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(ReadKeyRing({folder / "bad.pub"}).status().code(), ErrorCode::kBadData);
}

}  // namespace
}  // namespace panofix
