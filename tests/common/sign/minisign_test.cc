#include "common/sign/minisign.h"

#include <gtest/gtest.h>

#include "tests/support/test_signer.h"

namespace panofix {
namespace {

// Made by minisign 0.11: `minisign -G -W`, `minisign -S`, `minisign -S -l`.
constexpr char kPublicKey[] =
    "untrusted comment: minisign public key ACCD224A19AF94B9\n"
    "RWS5lK8ZSiLNrFIbKbIHc7iXraOA/tHJjx3Gx+vFxQQdReu3AKq3EJuJ\n";
constexpr char kMessage[] = "a message\n";
constexpr char kSignature[] =
    "untrusted comment: c\n"
    "RUS5lK8ZSiLNrGsecSLkhEug1+T311g2/"
    "MOROpERhSHZQjF1z5hTAhs6QraOz7+cKDZ792+jstabs7NrulOpQWGEGEr6QmA"
    "QZAc=\n"
    "trusted comment: a trusted comment\n"
    "PeB5Y5PtlQ85wbEAFNLRz7D5zt90ZoD8CZTrwDDTslDvCCXMwtcNT0BIyT0NlG2dD/3gA6LLPFM/nUi8AVhECQ==\n";
constexpr char kLegacySignature[] =
    "untrusted comment: c\n"
    "RWS5lK8ZSiLNrMsLwI5lvICoy+"
    "WeZdcReJD6DoTSSDYBDKDzd4vOUDxSjzABhKBOhV2Ug7MZxA5MEjZPqQ3sVXJ9aI7qPkd"
    "hDgw=\n"
    "trusted comment: a trusted comment\n"
    "qt9PHvDbctp35jpTil/tVcGNb/OpIqORwXsr/dZndNLG5BB+L4a4VZDFNTk4ja1Q8e5HLu/RD4j6qjSas+WYDw==\n";

TEST(Minisign, VerifiesWhatMinisignSigned) {
  const auto key = ParsePublicKey(kPublicKey, "k");
  ASSERT_TRUE(key.ok()) << key.status().message();
  EXPECT_EQ(KeyIdText(key->id), "ACCD224A19AF94B9");
  EXPECT_EQ(FormatPublicKey(*key), kPublicKey);
  for (const char* text : {kSignature, kLegacySignature}) {
    const auto signature = ParseSignature(text, "s");
    ASSERT_TRUE(signature.ok()) << signature.status().message();
    EXPECT_EQ(signature->trusted_comment, "a trusted comment");
    EXPECT_EQ(FormatSignature(*signature, "c"), text);
    EXPECT_TRUE(Verifies(kMessage, *signature, *key));
    EXPECT_FALSE(Verifies("a message", *signature, *key));
    EXPECT_FALSE(Verifies("", *signature, *key));
  }
}

TEST(Minisign, EveryFlippedBitOfASignatureIsFound) {
  const PublicKey key = ParsePublicKey(kPublicKey, "k").value();
  const Signature good = ParseSignature(kSignature, "s").value();
  for (std::size_t bit = 0; bit < 512; ++bit) {
    Signature bad = good;
    bad.signature[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_FALSE(Verifies(kMessage, bad, key));
    bad = good;
    bad.global_signature[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_FALSE(Verifies(kMessage, bad, key));
  }
  Signature bad = good;
  bad.trusted_comment += ' ';
  EXPECT_FALSE(Verifies(kMessage, bad, key));
  bad = good;
  bad.is_prehashed = false;
  EXPECT_FALSE(Verifies(kMessage, bad, key));
  bad = good;
  bad.key_id[0] ^= 1;
  EXPECT_FALSE(Verifies(kMessage, bad, key));
}

TEST(Minisign, KeyIdsAreTakenWhole) {
  EXPECT_EQ(KeyIdFromText("ACCD224A19AF94B9"), "ACCD224A19AF94B9");
  EXPECT_EQ(KeyIdFromText("0b1f33cf2d8bfdbf"), "0B1F33CF2D8BFDBF");
  for (const char* text :
       {"", "x", "ACCD224A19AF94B", "ACCD224A19AF94BX", "ACCD224A19AF94B90", "AC CD", "-1"})
    EXPECT_FALSE(KeyIdFromText(text)) << text;
}

TEST(Minisign, AKeyMayStandWithoutItsComment) {
  const std::string text = kPublicKey;
  EXPECT_EQ(ParsePublicKey(text.substr(text.find('\n') + 1), "k").value(),
            ParsePublicKey(text, "k").value());
}

TEST(Minisign, WhatIsNoKeyIsRefused) {
  const std::string good = kPublicKey;
  for (const std::string& text :
       {std::string(), std::string("\n"), good + "more\n", good.substr(0, good.size() - 3) + "\n",
        std::string("untrusted comment: x\nRWS5\n"), good + std::string(20000, 'x'),
        std::string(kSignature)}) {
    const auto key = ParsePublicKey(text, "a.pub");
    EXPECT_EQ(key.status().code(), ErrorCode::kBadData) << text.substr(0, 80);
    EXPECT_EQ(key.status().message().rfind("a.pub: ", 0), 0U);
  }
}

TEST(Minisign, WhatIsNoSignatureIsRefused) {
  const std::string good = kSignature;
  const auto with_comment = [](const std::string& comment) {
    Signature s = ParseSignature(kSignature, "s").value();
    std::string text = FormatSignature(s, "c");
    return text.replace(text.find("a trusted comment"), 17, comment);
  };
  for (const std::string& text :
       {std::string(), std::string(kPublicKey), good.substr(0, good.size() / 2), good + good,
        good + std::string(20000, 'x'), with_comment(std::string(9000, 'x')),
        with_comment("\x1b[2J"), std::string("\xff\xfe\n\n\n\n")}) {
    EXPECT_EQ(ParseSignature(text, "a").status().code(), ErrorCode::kBadData) << text.substr(0, 80);
  }
  EXPECT_TRUE(ParseSignature(with_comment(std::string(8000, 'x')), "a").ok());
}

TEST(Minisign, CommentsOfTwoLinesAreNotWritten) {
  const Signature s = ParseSignature(kSignature, "s").value();
  EXPECT_THROW((void)FormatSignature(s, "a\nb"), std::logic_error);
}

TEST(Minisign, OtherKeysDoNotVerify) {
  const TestSigner one(1), other(2);
  const Signature signature = ParseSignature(one.Sign("m", "c"), "s").value();
  EXPECT_TRUE(Verifies("m", signature, one.key()));
  PublicKey forged = other.key();
  forged.id = one.key().id;
  EXPECT_FALSE(Verifies("m", signature, forged));
}

}  // namespace
}  // namespace panofix
