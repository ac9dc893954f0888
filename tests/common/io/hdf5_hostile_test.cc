// Faults that end or fill the process: each runs in a child or on a disk of its own.
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/base/rng.h"
#include "common/io/hdf5_file.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr int kNumRows = 500;

void WriteSample(const fs::path& path) {
  std::vector<float> values(kNumRows * 3, 1.5F);
  Hdf5Writer writer(path);
  writer.Write<float>("group/x", values, 3);
  writer.WriteStrings("ids", {"a", "b"});
  writer.WriteAttribute("version", std::int64_t{1});
  writer.Close();
}

// 0 where every answer is a Status or a value of a shape that its size allows; 1 otherwise.
int ReadAll(const fs::path& path) {
  const auto reader = Hdf5Reader::Open(path);
  if (!reader.ok()) return 0;
  const auto x = reader->Read<float>("group/x", -1);
  if (x.ok()) {
    const auto file_bytes = static_cast<std::int64_t>(fs::file_size(path));
    if (x->rows < 0 || x->cols < 1 || x->rows * x->cols * 4 > file_bytes) return 1;
    float sum = 0;
    for (const float value : x->values) sum += value;  // touches every mapped byte
    if (sum == 0.25F) return 2;                        // keeps the loop
  }
  (void)reader->ReadStrings("ids");
  (void)reader->ReadIntAttribute("version");
  return 0;
}

// The library itself may crash on flipped bytes (hence "verify the hash first"); what must hold is
// that our code never calls a wrong answer right, and that nothing reads beyond the file.
TEST(Hdf5Hostile, FlippedBytesGiveAStatusOrAPossibleShape) {
  const TempFolder folder;
  WriteSample(folder / "good.h5");
  const std::string good = ReadText(folder / "good.h5");
  Rng rng(7, "test/hdf5_flips");
  constexpr int kFlips = 150;
  int num_honest = 0;
  for (int i = 0; i < kFlips; ++i) {
    std::string bad = good;
    const auto at = static_cast<std::size_t>(rng.Below(bad.size()));
    bad[at] = static_cast<char>(bad[at] ^ static_cast<char>(1 + rng.Below(255)));
    WriteText(folder / "bad.h5", bad);
    const pid_t child = ::fork();
    if (child == 0) ::_exit(ReadAll(folder / "bad.h5"));
    int state = 0;
    ASSERT_EQ(::waitpid(child, &state, 0), child);
    if (!WIFEXITED(state)) continue;  // the library crashed
    EXPECT_EQ(WEXITSTATUS(state), 0) << "flip " << i << " at byte " << at;
    ++num_honest;
  }
  EXPECT_GT(num_honest, kFlips / 2);
}

TEST(Hdf5Hostile, FullDiskIsNoSpaceAndTheProgramGoesOn) {
  const TempFolder folder;
  const fs::path mount = folder / "tiny";
  fs::create_directory(mount);
  if (::mount("tmpfs", mount.c_str(), "tmpfs", 0, "size=256k") != 0) {
    GTEST_SKIP() << "mounting a tiny disk needs root";
  }
  const std::vector<std::uint8_t> large(4'000'000, 7);
  ErrorCode code = ErrorCode::kOk;
  try {
    Hdf5Writer writer(mount / "f.h5");
    writer.Write<std::uint8_t>("x", large);
    writer.Close();
  } catch (const Error& error) {
    code = error.code();
  }
  EXPECT_EQ(code, ErrorCode::kNoSpace);
  EXPECT_TRUE(fs::is_empty(mount));
  WriteSample(folder / "elsewhere.h5");
  EXPECT_EQ(ReadAll(folder / "elsewhere.h5"), 0);
  EXPECT_EQ(::umount2(mount.c_str(), MNT_DETACH), 0);
}

}  // namespace
}  // namespace panofix
