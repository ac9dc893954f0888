#include "common/io/sha256.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

// FIPS 180-4 example values (NIST, "Secure Hash Standard", and its long-message vector).
constexpr const char* kEmptyHash =
    "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
constexpr const char* kAbcHash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr const char* kTwoBlocksHash =
    "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1";
constexpr const char* kMillionHash =
    "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0";

TEST(Sha256, MatchesPublishedVectors) {
  EXPECT_EQ(Sha256Hex(""), kEmptyHash);
  EXPECT_EQ(Sha256Hex("abc"), kAbcHash);
  EXPECT_EQ(Sha256Hex("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"), kTwoBlocksHash);
  EXPECT_EQ(Sha256Hex(std::string(1'000'000, 'a')), kMillionHash);
}

TEST(Sha256, PiecesMakeTheSameHash) {
  Sha256 hash;
  for (int i = 0; i < 1000; ++i) hash.Update(std::string(1000, 'a'));
  EXPECT_EQ(hash.FinishHex(), kMillionHash);
}

TEST(Sha256, UseAfterFinishIsACallersBug) {
  Sha256 hash;
  EXPECT_EQ(hash.FinishHex(), kEmptyHash);
  EXPECT_THROW(hash.Update("x"), std::logic_error);
  EXPECT_THROW((void)hash.FinishHex(), std::logic_error);
}

TEST(Sha256, FilesLargerThanOneBlock) {
  const TempFolder folder;
  const std::string text(3'500'001, 'q');
  WriteText(folder / "big", text);
  const auto hash = Sha256OfFile(folder / "big");
  ASSERT_TRUE(hash.ok()) << hash.status().message();
  EXPECT_EQ(*hash, Sha256Hex(text));
}

TEST(Sha256, DescriptorIsReadFromItsStartAndKeepsItsPosition) {
  const TempFolder folder;
  WriteText(folder / "abc", "abc");
  const int fd = ::open((folder / "abc").c_str(), O_RDONLY);
  ASSERT_GE(fd, 0);
  ASSERT_EQ(::lseek(fd, 2, SEEK_SET), 2);
  const auto hash = Sha256OfDescriptor(fd, "abc");
  ASSERT_TRUE(hash.ok()) << hash.status().message();
  EXPECT_EQ(*hash, kAbcHash);
  EXPECT_EQ(::lseek(fd, 0, SEEK_CUR), 2);
  ::close(fd);
}

TEST(Sha256, FailuresNameTheFile) {
  const TempFolder folder;
  const auto absent = Sha256OfFile(folder / "absent");
  ASSERT_FALSE(absent.ok());
  EXPECT_EQ(absent.status().code(), ErrorCode::kNotFound);
  EXPECT_NE(absent.status().message().find("absent"), std::string::npos);
  const auto directory = Sha256OfFile(folder.path());
  ASSERT_FALSE(directory.ok());
  EXPECT_EQ(directory.status().code(), ErrorCode::kIo);
  EXPECT_EQ(Sha256OfDescriptor(-1, "closed").status().code(), ErrorCode::kIo);
}

}  // namespace
}  // namespace panofix
