#include "common/io/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

int NumEntries(const fs::path& folder) {
  int count = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder)) ++count;
  return count;
}

// The code of `work`, done in a child process as a user without rights.
template <typename Work>
ErrorCode CodeAsNobody(const Work& work) {
  const pid_t child = ::fork();
  if (child == 0) {
    constexpr uid_t kNobody = 65534;
    if (::geteuid() == 0 && ::setuid(kNobody) != 0) ::_exit(255);
    ::_exit(static_cast<int>(work().code()));
  }
  int state = 0;
  ::waitpid(child, &state, 0);
  return static_cast<ErrorCode>(WEXITSTATUS(state));
}

TEST(WriteFileAtomically, WritesAndReplaces) {
  const TempFolder folder;
  const fs::path path = folder / "a.txt";
  ASSERT_TRUE(WriteFileAtomically(path, "one").ok());
  EXPECT_EQ(ReadText(path), "one");
  const std::string binary("\0\xff\n", 3);
  ASSERT_TRUE(WriteFileAtomically(path, binary).ok());
  EXPECT_EQ(ReadText(path), binary);
  ASSERT_TRUE(WriteFileAtomically(path, "").ok());
  EXPECT_EQ(ReadText(path), "");
  EXPECT_EQ(NumEntries(folder.path()), 1);  // no temporary file stays
}

TEST(WriteFileAtomically, FollowsALinkToItsFile) {
  const TempFolder folder;
  WriteText(folder / "real", "old");
  fs::create_symlink(folder / "real", folder / "link");
  ASSERT_TRUE(WriteFileAtomically(folder / "link", "new").ok());
  EXPECT_TRUE(fs::is_symlink(folder / "link"));
  EXPECT_EQ(ReadText(folder / "real"), "new");
}

TEST(WriteFileAtomically, MissingFolderAndFolderAsFile) {
  const TempFolder folder;
  const Status missing = WriteFileAtomically(folder / "no/a.txt", "x");
  EXPECT_EQ(missing.code(), ErrorCode::kNotFound);
  EXPECT_NE(missing.message().find("no/a.txt"), std::string::npos);
  EXPECT_EQ(WriteFileAtomically(folder.path(), "x").code(), ErrorCode::kInvalidArgument);
  WriteText(folder / "file", "x");
  EXPECT_EQ(WriteFileAtomically(folder / "file/a.txt", "x").code(), ErrorCode::kNotFound);
}

TEST(WriteFileAtomically, ReadOnlyFolderKeepsTheOldFile) {
  const TempFolder folder;
  WriteText(folder / "ro/a.txt", "old");
  fs::permissions(folder.path(), fs::perms::owner_all | fs::perms::others_exec);
  fs::permissions(folder / "ro", fs::perms::owner_read | fs::perms::owner_exec |
                                     fs::perms::others_read | fs::perms::others_exec);
  EXPECT_EQ(CodeAsNobody([&] { return WriteFileAtomically(folder / "ro/a.txt", "new"); }),
            ErrorCode::kIo);
  EXPECT_EQ(ReadText(folder / "ro/a.txt"), "old");
  EXPECT_EQ(NumEntries(folder / "ro"), 1);
  fs::permissions(folder / "ro", fs::perms::owner_all);
}

TEST(WriteFileAtomically, FullDeviceIsNoSpace) {
  const Status status = WriteFileAtomically("/dev/full", "x");
  EXPECT_EQ(status.code(), ErrorCode::kNoSpace);
  EXPECT_TRUE(fs::is_character_file("/dev/full"));  // written through, not replaced
}

TEST(WriteFileAtomically, FullDiskKeepsTheOldFile) {
  const TempFolder folder;
  const fs::path mount = folder / "tiny";
  fs::create_directory(mount);
  if (::mount("tmpfs", mount.c_str(), "tmpfs", 0, "size=64k") != 0) {
    GTEST_SKIP() << "mounting a tiny disk needs root";
  }
  EXPECT_TRUE(WriteFileAtomically(mount / "a", std::string(20'000, 'a')).ok());
  EXPECT_EQ(WriteFileAtomically(mount / "a", std::string(200'000, 'b')).code(),
            ErrorCode::kNoSpace);
  EXPECT_EQ(ReadText(mount / "a"), std::string(20'000, 'a'));
  EXPECT_EQ(NumEntries(mount), 1);
  EXPECT_EQ(::umount(mount.c_str()), 0);
}

TEST(SyncPath, FilesFoldersAndNothing) {
  const TempFolder folder;
  WriteText(folder / "a", "x");
  EXPECT_TRUE(SyncPath(folder / "a").ok());
  EXPECT_TRUE(SyncPath(folder.path()).ok());
  EXPECT_EQ(SyncPath(folder / "b").code(), ErrorCode::kNotFound);
}

TEST(PublishDirectory, NewTargetThenReplacement) {
  const TempFolder folder;
  WriteText(folder / "stage/v", "1");
  ASSERT_TRUE(PublishDirectory(folder / "stage/", folder / "bundle/").ok());
  EXPECT_EQ(ReadText(folder / "bundle/v"), "1");
  EXPECT_FALSE(fs::exists(folder / "stage"));
  WriteText(folder / "stage/v", "2");
  ASSERT_TRUE(PublishDirectory(folder / "stage", folder / "bundle").ok());
  EXPECT_EQ(ReadText(folder / "bundle/v"), "2");
  EXPECT_EQ(NumEntries(folder.path()), 1);
}

TEST(PublishDirectory, RefusesWhatIsNotAFolder) {
  const TempFolder folder;
  WriteText(folder / "file", "keep");
  WriteText(folder / "stage/v", "1");
  EXPECT_EQ(PublishDirectory(folder / "absent", folder / "b").code(), ErrorCode::kNotFound);
  EXPECT_EQ(PublishDirectory(folder / "file", folder / "b").code(), ErrorCode::kNotFound);
  EXPECT_EQ(PublishDirectory(folder / "stage", folder / "file").code(),
            ErrorCode::kInvalidArgument);
  EXPECT_EQ(PublishDirectory(folder / "stage", folder / "no/b").code(), ErrorCode::kNotFound);
  EXPECT_EQ(PublishDirectory(folder / "stage", folder / "stage").code(),
            ErrorCode::kInvalidArgument);
  EXPECT_EQ(ReadText(folder / "file"), "keep");
  EXPECT_EQ(ReadText(folder / "stage/v"), "1");
}

TEST(PublishDirectory, TargetInsideTheStagedFolderStaysWhole) {
  const TempFolder folder;
  WriteText(folder / "stage/v", "1");
  WriteText(folder / "stage/inner/v", "2");
  EXPECT_FALSE(PublishDirectory(folder / "stage", folder / "stage/inner").ok());
  EXPECT_EQ(ReadText(folder / "stage/v"), "1");
  EXPECT_EQ(ReadText(folder / "stage/inner/v"), "2");
}

// A reader that looks by path at any time finds a whole version.
TEST(PublishDirectory, ReaderSeesOldOrNewNeverNothing) {
  const TempFolder folder;
  const fs::path target = folder / "bundle";
  WriteText(target / "a", "0");
  std::atomic<bool> done{false};
  std::atomic<int> num_missing{0}, num_seen{0};
  std::thread reader([&] {
    while (!done) {
      (fs::exists(target / "a") ? num_seen : num_missing)++;
    }
  });
  constexpr int kVersions = 200;
  for (int i = 1; i <= kVersions; ++i) {
    WriteText(folder / "stage/a", std::to_string(i));
    ASSERT_TRUE(PublishDirectory(folder / "stage", target).ok());
  }
  while (num_seen == 0) std::this_thread::yield();
  done = true;
  reader.join();
  EXPECT_EQ(num_missing, 0);
  EXPECT_EQ(ReadText(target / "a"), std::to_string(kVersions));
}

}  // namespace
}  // namespace panofix
