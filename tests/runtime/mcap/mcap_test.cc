// What is written is read back; what is cut or damaged is told, never believed.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include <fstream>

#include "common/base/rng.h"
#include "runtime/mcap/mcap_reader.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes ReadAll(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
void WriteAll(const std::filesystem::path& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

// Two channels, metadata between messages.
void WriteSample(const std::filesystem::path& path) {
  McapWriter writer = ValueOrThrow(McapWriter::Create(path));
  const Bytes schema{1, 2, 3};
  const auto a = ValueOrThrow(writer.AddChannel("a", {"A", "flatbuffer", schema}));
  const auto b = ValueOrThrow(writer.AddChannel("b", {"B", "flatbuffer", schema}));
  ThrowIfError(writer.WriteMetadata("about", {{"key", "value"}, {"empty", ""}}));
  ThrowIfError(writer.WriteMessage(a, 10, 1, Bytes{7, 8}));
  ThrowIfError(writer.WriteMessage(b, 20, 2, Bytes{}));
  ThrowIfError(writer.WriteMessage(a, 30, std::uint64_t{1} << 60, Bytes(1000, 9)));
  ThrowIfError(writer.Finish());
}

struct Read {
  std::vector<McapRecord> records;
  Status status;
  bool was_cut = false;
};
Read ReadRecords(const std::filesystem::path& path, std::size_t max_bytes = 1 << 20) {
  Read read;
  auto reader = McapReader::Open(path, max_bytes);
  if (!reader.ok()) {
    read.status = reader.status();
    return read;
  }
  while (true) {
    auto record = reader->Next();
    if (!record.ok()) read.status = record.status();
    if (!record.ok() || !record->has_value()) break;
    read.records.push_back(std::move(**record));
  }
  read.was_cut = reader->was_cut();
  return read;
}

TEST(Mcap, ComesBackAsWritten) {
  const TempFolder folder;
  WriteSample(folder / "x.mcap");
  const Read read = ReadRecords(folder / "x.mcap");
  EXPECT_TRUE(read.status.ok()) << read.status.message();
  EXPECT_FALSE(read.was_cut);
  ASSERT_EQ(read.records.size(), 4U);
  EXPECT_EQ(read.records[0].name, "about");
  EXPECT_EQ(read.records[0].metadata, (McapMetadata{{"key", "value"}, {"empty", ""}}));
  EXPECT_EQ(read.records[1].name, "a");
  EXPECT_EQ(read.records[1].data, (Bytes{7, 8}));
  EXPECT_EQ(read.records[2].name, "b");
  EXPECT_TRUE(read.records[2].data.empty());
  EXPECT_EQ(read.records[3].captured_ns, std::uint64_t{1} << 60);
  EXPECT_EQ(read.records[3].data, Bytes(1000, 9));
}

TEST(Mcap, WhatIsThereIsNotOverwritten) {
  const TempFolder folder;
  WriteSample(folder / "x.mcap");
  const Bytes before = ReadAll(folder / "x.mcap");
  EXPECT_EQ(McapWriter::Create(folder / "x.mcap").status().code(), ErrorCode::kInvalidArgument);
  EXPECT_EQ(ReadAll(folder / "x.mcap"), before);
}

TEST(Mcap, ACutFileGivesItsWholeRecords) {
  const TempFolder folder;
  WriteSample(folder / "x.mcap");
  const Bytes whole = ReadAll(folder / "x.mcap");
  std::size_t most = 0;
  for (std::size_t size = 8; size < whole.size(); size += size < 400 ? 1 : 97) {
    WriteAll(folder / "cut.mcap", Bytes(whole.begin(), whole.begin() + std::ptrdiff_t(size)));
    const Read read = ReadRecords(folder / "cut.mcap");
    EXPECT_TRUE(read.status.ok()) << size << ": " << read.status.message();
    EXPECT_GE(read.records.size(), most) << size;
    most = read.records.size();
    if (most < 4) {
      EXPECT_TRUE(read.was_cut) << size;
    }
  }
  EXPECT_EQ(most, 4U);
}

TEST(Mcap, DamageNeverCrashesOrTakesMuchMemory) {
  const TempFolder folder;
  WriteSample(folder / "x.mcap");
  const Bytes whole = ReadAll(folder / "x.mcap");
  Rng rng(1, "mcap");
  for (int round = 0; round < 2000; ++round) {
    Bytes bytes = whole;
    for (int i = 0; i < 3; ++i) {
      bytes[rng.Below(std::min<std::size_t>(bytes.size(), 400))] =
          static_cast<std::uint8_t>(rng.Below(256));
    }
    WriteAll(folder / "bad.mcap", bytes);
    for (const McapRecord& record : ReadRecords(folder / "bad.mcap").records) {
      EXPECT_LE(record.data.size(), whole.size());
    }
  }
}

TEST(Mcap, TooLargeARecordIsRefused) {
  const TempFolder folder;
  WriteSample(folder / "x.mcap");
  const Read read = ReadRecords(folder / "x.mcap", 500);
  EXPECT_EQ(read.status.code(), ErrorCode::kBadData);
  EXPECT_NE(read.status.message().find("x.mcap"), std::string::npos);
  EXPECT_EQ(read.records.size(), 3U);
}

// A limit on the file's size stands in for a disk that is full.
TEST(Mcap, AFullDiskLeavesWholeRecords) {
  const TempFolder folder;
  McapWriter writer = ValueOrThrow(McapWriter::Create(folder / "x.mcap"));
  const auto id = ValueOrThrow(writer.AddChannel("a", {"A", "flatbuffer", {}}));
  ThrowIfError(writer.WriteMessage(id, 1, 1, Bytes(100, 1)));
  const auto before = std::filesystem::file_size(folder / "x.mcap");
  rlimit old{};
  getrlimit(RLIMIT_FSIZE, &old);
  const rlimit small{before + 50, old.rlim_max};
  auto* const handler = signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &small);
  const Status full = writer.WriteMessage(id, 2, 2, Bytes(100, 2));
  const Status after = writer.WriteMessage(id, 3, 3, Bytes(1, 3));
  setrlimit(RLIMIT_FSIZE, &old);
  signal(SIGXFSZ, handler);
  EXPECT_EQ(full.code(), ErrorCode::kNoSpace) << full.message();
  EXPECT_EQ(after.code(), ErrorCode::kNoSpace) << "it takes no more, even what would fit";
  EXPECT_EQ(std::filesystem::file_size(folder / "x.mcap"), before);
  EXPECT_EQ(ReadRecords(folder / "x.mcap").records.size(), 1U);
}

TEST(Mcap, OtherFilesAreNamed) {
  const TempFolder folder;
  EXPECT_EQ(McapReader::Open(folder / "none").status().code(), ErrorCode::kNotFound);
  WriteAll(folder / "short", {1, 2});
  EXPECT_EQ(McapReader::Open(folder / "short").status().code(), ErrorCode::kBadData);
}

}  // namespace
}  // namespace panofix
