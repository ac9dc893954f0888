#include "builder/ship/release.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "common/map/map_bundle.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

class ReleaseTest : public testing::Test {
 protected:
  ReleaseTest() {
    SmallBundle().Write(folder_ / "b");
    options_.created_s = 1800000000;
  }
  [[nodiscard]] KeyRing Ring() const { return {{key_.public_key()}, {}}; }
  const TempFolder folder_;
  const SecretKey key_ = SecretKey::Generate();
  ReleaseOptions options_;
};

TEST_F(ReleaseTest, ASignedBundleOpensWithItsKeyAndKeepsItsId) {
  const std::string id = MapBundle::Open(folder_ / "b").value()->id();
  EXPECT_EQ(MapBundle::Open(folder_ / "b", Ring()).status().code(), ErrorCode::kUntrusted);
  WriteText(folder_ / "score.json",
            R"({"num_frames": 4, "num_fixes": 2, "share_fix": 0.5, "share_false_fixes": 0,)"
            R"("median_position_error_m": null, "frames": [1]})");
  options_.scores = folder_ / "score.json";
  options_.revoked_keys = {"00000000000000aa"};
  options_.expires_days = 0.5;
  const ReleaseStatement said = SignBundle(folder_ / "b", key_, options_);
  const auto bundle = MapBundle::Open(folder_ / "b", Ring());
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_EQ((*bundle)->id(), id);
  ASSERT_TRUE((*bundle)->release().has_value());
  const ReleaseStatement& statement = (*bundle)->release()->statement;
  EXPECT_EQ(statement.name, "small");
  EXPECT_EQ(statement.created_s, 1800000000);
  EXPECT_EQ(statement.expires_s, 1800043200);
  EXPECT_EQ(statement.revoked_keys, std::vector<std::string>{"00000000000000AA"});
  EXPECT_EQ(
      statement.quality,
      (std::map<std::string, double>{
          {"num_frames", 4}, {"num_fixes", 2}, {"share_fix", 0.5}, {"share_false_fixes", 0}}));
  EXPECT_EQ(said.expires_s, statement.expires_s);
  // Without a key to verify with it counts as unsigned.
  EXPECT_FALSE(MapBundle::Open(folder_ / "b").value()->release().has_value());
}

TEST_F(ReleaseTest, SigningAgainRenewsIt) {
  SignBundle(folder_ / "b", key_, options_);
  const std::string first = ReadText(folder_ / "b" / kManifestSignatureName);
  SignBundle(folder_ / "b", key_, options_);
  EXPECT_EQ(ReadText(folder_ / "b" / kManifestSignatureName), first) << "equal options";
  options_.created_s += 1000;
  SignBundle(folder_ / "b", key_, options_);
  EXPECT_NE(ReadText(folder_ / "b" / kManifestSignatureName), first);
  EXPECT_TRUE(MapBundle::Open(folder_ / "b", Ring()).ok());
}

TEST_F(ReleaseTest, ADamagedBundleIsNotSigned) {
  std::filesystem::resize_file(folder_ / "b" / "tiles/1.h5", 10);
  EXPECT_THROW(SignBundle(folder_ / "b", key_, options_), Error);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "b" / kManifestSignatureName));
}

TEST_F(ReleaseTest, OptionsHaveTheirRules) {
  for (const double days : {0.0, -1.0, 1e9, std::nan("")}) {
    options_.expires_days = days;
    EXPECT_THROW(SignBundle(folder_ / "b", key_, options_), std::invalid_argument) << days;
  }
  options_.expires_days = 1;
  options_.latest_created_s = options_.created_s - 1;
  EXPECT_THROW(SignBundle(folder_ / "b", key_, options_), std::invalid_argument);
  options_.latest_created_s = options_.created_s;
  EXPECT_NO_THROW(SignBundle(folder_ / "b", key_, options_));
  options_.scores = folder_ / "score.json";
  for (const char* table : {"[]", "{}", R"({"version": 1})",
                            R"({"num_frames": 4, "num_fixes": 2, "share_fix": 0.5})"}) {
    WriteText(folder_ / "score.json", table);
    EXPECT_THROW(SignBundle(folder_ / "b", key_, options_), Error) << table;
  }
  options_.scores.clear();
  for (const char* id : {"not an id", "aa", "00000000000000a", "00000000000000aa0"}) {
    options_.revoked_keys = {id};
    EXPECT_THROW(SignBundle(folder_ / "b", key_, options_), Error) << id;
  }
}

TEST_F(ReleaseTest, EndorsementsLeadFromKeyToKey) {
  const SecretKey next = SecretKey::Generate();
  WriteText(folder_ / "next.pub", FormatPublicKey(next.public_key()));
  EndorseKey(folder_ / "next.pub", key_);
  const auto endorsed = VerifyEndorsement(Ring(), ReadText(folder_ / "next.pub"),
                                          ReadText(folder_ / "next.pub.minisig"), "next.pub");
  ASSERT_TRUE(endorsed.ok()) << endorsed.status().message();
  EXPECT_EQ(*endorsed, next.public_key());
}

TEST_F(ReleaseTest, KeyFilesAreTheOwnersAndNeverReplaced) {
  const PublicKey key = WriteKeyPair(folder_ / "k.key", folder_ / "k.pub", "");
  struct stat info {};
  ASSERT_EQ(::stat((folder_ / "k.key").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600U);
  EXPECT_EQ(SecretKey::Read(folder_ / "k.key", "").public_key(), key);
  const std::string before = ReadText(folder_ / "k.key");
  EXPECT_THROW(WriteKeyPair(folder_ / "k.key", folder_ / "other.pub", ""), Error);
  EXPECT_THROW(WriteKeyPair(folder_ / "other.key", folder_ / "k.pub", ""), Error);
  EXPECT_EQ(ReadText(folder_ / "k.key"), before);
}

}  // namespace
}  // namespace panofix
