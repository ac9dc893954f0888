#include "builder/ship/secret_key.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "common/sign/key_ring.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

ErrorCode CodeOf(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.code();
  }
  return ErrorCode::kOk;
}

TEST(SecretKey, SignsWhatItsPublicKeyVerifies) {
  const SecretKey key = SecretKey::Generate();
  const KeyRing ring{{key.public_key()}, {}};
  const std::string signature = key.Sign("message", "comment");
  EXPECT_EQ(key.Sign("message", "comment"), signature) << "equal arguments, equal text";
  const auto verified = VerifyWith(ring, "message", signature, "m");
  ASSERT_TRUE(verified.ok()) << verified.status().message();
  EXPECT_EQ(verified->trusted_comment, "comment");
  EXPECT_FALSE(VerifyWith(ring, "massage", signature, "m").ok());
  EXPECT_NE(SecretKey::Generate().public_key(), key.public_key());
}

// Hashing a password takes a gigabyte and a second or more, so one file serves all questions.
TEST(SecretKey, RoundTripWithAndWithoutPassword) {
  const SecretKey key = SecretKey::Generate();
  const std::string open = key.Format(""), locked = key.Format("right");
  EXPECT_EQ(SecretKey::Parse(open, "", "k").Sign("m", "c"), key.Sign("m", "c"));
  const SecretKey back = SecretKey::Parse(locked, "right", "k");
  EXPECT_EQ(back.public_key(), key.public_key());
  EXPECT_EQ(back.Sign("m", "c"), key.Sign("m", "c"));
  EXPECT_EQ(CodeOf([&] { SecretKey::Parse(locked, "", "k"); }), ErrorCode::kInvalidArgument);
  EXPECT_EQ(CodeOf([&] { SecretKey::Parse(locked, "wrong", "k"); }), ErrorCode::kInvalidArgument);
}

TEST(SecretKey, DamageIsFound) {
  const std::string text = SecretKey::Generate().Format("");
  const std::size_t body = text.find('\n') + 1;
  for (const std::string& bad : {std::string(), std::string("untrusted comment: x\nRWQ=\n"),
                                 text.substr(0, text.size() / 2), text.substr(body)}) {
    EXPECT_EQ(CodeOf([&] { SecretKey::Parse(bad, "", "k"); }), ErrorCode::kBadData) << bad;
  }
  std::string flipped = text;
  flipped[body + 100] = flipped[body + 100] == 'A' ? 'B' : 'A';
  EXPECT_EQ(CodeOf([&] { SecretKey::Parse(flipped, "", "k"); }), ErrorCode::kBadData);
}

// The tool that people know reads and writes the same files.
class Minisign : public testing::Test {
 protected:
  [[nodiscard]] bool Runs(const std::string& arguments) const {
    const std::string command =
        "cd '" + folder_.path().string() + "' && minisign " + arguments + " >/dev/null 2>&1";
    return std::system(command.c_str()) == 0;
  }
  const TempFolder folder_;
};

TEST_F(Minisign, VerifiesOurSignatures) {
  const SecretKey key = SecretKey::Generate();
  WriteText(folder_ / "k.pub", FormatPublicKey(key.public_key()));
  WriteText(folder_ / "m", "message");
  WriteText(folder_ / "m.minisig", key.Sign("message", std::string(8000, 'x')));
  EXPECT_TRUE(Runs("-V -p k.pub -m m")) << "is minisign installed?";
  WriteText(folder_ / "m", "massage");
  EXPECT_FALSE(Runs("-V -p k.pub -m m"));
}

TEST_F(Minisign, SignsWithOurKeys) {
  const SecretKey key = SecretKey::Generate();
  WriteText(folder_ / "k.key", key.Format(""));
  WriteText(folder_ / "m", "message");
  for (const char* hashing : {"", "-l "}) {
    ASSERT_TRUE(Runs(std::string("-S -W -s k.key -m m -t theirs ") + hashing));
    const auto verified =
        VerifyWith({{key.public_key()}, {}}, "message", ReadText(folder_ / "m.minisig"), "m");
    ASSERT_TRUE(verified.ok()) << verified.status().message();
    EXPECT_EQ(verified->trusted_comment, "theirs");
  }
}

TEST_F(Minisign, ItsKeysSignHere) {
  ASSERT_TRUE(Runs("-G -W -p k.pub -s k.key"));
  const SecretKey key = SecretKey::Read(folder_ / "k.key", "");
  EXPECT_EQ(key.public_key(), ParsePublicKey(ReadText(folder_ / "k.pub"), "k.pub").value());
  WriteText(folder_ / "m", "message");
  WriteText(folder_ / "m.minisig", key.Sign("message", "ours"));
  EXPECT_TRUE(Runs("-V -p k.pub -m m"));
}

}  // namespace
}  // namespace panofix
