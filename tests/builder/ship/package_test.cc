#include "builder/ship/package.h"

#include <gtest/gtest.h>
#include <zstd.h>

#include <cstdlib>

#include "builder/ship/patch.h"
#include "builder/ship/release.h"
#include "common/base/rng.h"
#include "common/package/delta_index.h"
#include "common/package/tar_header.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// Names and contents of a package's entries, read block by block.
std::vector<std::pair<std::string, std::string>> ReadPackage(const fs::path& path) {
  const std::string bytes = ReadText(path);
  std::vector<std::pair<std::string, std::string>> entries;
  for (std::size_t at = 0; at + kTarBlockBytes <= bytes.size();) {
    TarBlock block;
    std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), kTarBlockBytes, block.begin());
    const auto entry = DecodeTarHeader(block, path).value();
    at += kTarBlockBytes;
    if (!entry) continue;
    entries.emplace_back(entry->name, bytes.substr(at, entry->num_bytes));
    at += entry->num_bytes + TarPadding(entry->num_bytes);
  }
  return entries;
}

class PackageWriterTest : public testing::Test {
 protected:
  // One tile's points moved; `noise` bytes that compress to nothing beside it.
  fs::path Bundle(const std::string& name, float point, const std::string& noise = "") {
    CraftedBundle b = SmallBundle();
    b.tiles[1].points[0] = point;
    if (!noise.empty()) b.extra_parts.emplace_back("noise.bin", noise);
    b.Write(folder_ / name);
    ReleaseOptions options;
    options.created_s = 1800000000;
    SignBundle(folder_ / name, key_, options);
    return folder_ / name;
  }
  const TempFolder folder_;
  const SecretKey key_ = SecretKey::Generate();
};

std::string Noise(std::uint64_t seed) {
  Rng rng(seed, "tests/noise");
  std::string noise(50000, '\0');
  for (char& c : noise) c = static_cast<char>(rng.Below(256));
  return noise;
}

TEST_F(PackageWriterTest, AWholeBundle) {
  const fs::path bundle = Bundle("one", 1), out = folder_ / "one.pfb";
  const PackageReport report = WritePackage({}, bundle, {}, out);
  EXPECT_EQ(report.num_parts, 4U);
  EXPECT_EQ(report.num_objects, 4U);
  EXPECT_EQ(report.num_patches, 0U);
  EXPECT_EQ(report.num_package_bytes, fs::file_size(out));
  const auto entries = ReadPackage(out);
  ASSERT_EQ(entries.size(), 7U);
  EXPECT_EQ(entries[1].second, ReadText(bundle / kManifestName));
  const auto index = ParseDeltaIndex(entries[0].second, "d");
  ASSERT_TRUE(index.ok());
  EXPECT_EQ(index->base, "");
}

TEST_F(PackageWriterTest, OnlyWhatChanged) {
  const fs::path one = Bundle("one", 1, Noise(1)), two = Bundle("two", 2, Noise(2));
  const fs::path out = folder_ / "d.pfb";
  const PackageReport report = WritePackage(one, two, {}, out);
  EXPECT_EQ(report.num_patches, 1U) << "the tile";
  EXPECT_EQ(report.num_objects, 1U) << "noise has no patch that pays";
  const auto entries = ReadPackage(out);
  ASSERT_EQ(entries.size(), 5U);
  const DeltaIndex index = ParseDeltaIndex(entries[0].second, "d").value();
  EXPECT_EQ(index.patches.size(), 1U);
  // And the patch is one that zstd applies to the old tile.
  const std::string old_tile = ReadText(one / "tiles/1.h5"),
                    new_tile = ReadText(two / "tiles/1.h5");
  for (const auto& [name, content] : entries) {
    if (!name.starts_with("patches/")) continue;
    ZSTD_DCtx* context = ZSTD_createDCtx();
    ZSTD_DCtx_refPrefix(context, old_tile.data(), old_tile.size());
    std::string made(new_tile.size(), '\0');
    EXPECT_EQ(
        ZSTD_decompressDCtx(context, made.data(), made.size(), content.data(), content.size()),
        new_tile.size());
    ZSTD_freeDCtx(context);
    EXPECT_TRUE(made == new_tile);
    EXPECT_LT(content.size(), new_tile.size() / 10);
  }
}

TEST_F(PackageWriterTest, EqualArgumentsGiveEqualBytes) {
  const fs::path one = Bundle("one", 1), two = Bundle("two", 2);
  WritePackage(one, two, {}, folder_ / "a.pfb");
  WritePackage(one, two, {}, folder_ / "b.pfb");
  EXPECT_TRUE(ReadText(folder_ / "a.pfb") == ReadText(folder_ / "b.pfb"));
}

TEST_F(PackageWriterTest, TarListsIt) {
  WritePackage({}, Bundle("one", 1), {}, folder_ / "one.pfb");
  const std::string command =
      "tar -tf '" + (folder_ / "one.pfb").string() + "' >'" + (folder_ / "list").string() + "'";
  ASSERT_EQ(std::system(command.c_str()), 0);
  const std::string list = ReadText(folder_ / "list");
  EXPECT_EQ(list.rfind("delta.json\nmanifest.json\nmanifest.json.minisig\nobjects/", 0), 0U)
      << list;
}

TEST_F(PackageWriterTest, KeysComeAlong) {
  const SecretKey next = SecretKey::Generate();
  WriteText(folder_ / "next.pub", FormatPublicKey(next.public_key()));
  EXPECT_THROW(WritePackage({}, Bundle("one", 1), {folder_ / "next.pub"}, folder_ / "k.pfb"), Error)
      << "no endorsement beside it";
  EndorseKey(folder_ / "next.pub", key_);
  WritePackage({}, Bundle("one", 1), {folder_ / "next.pub"}, folder_ / "k.pfb");
  const auto entries = ReadPackage(folder_ / "k.pfb");
  EXPECT_EQ(entries[1].first, "keys/" + KeyIdText(next.public_key().id) + ".pub");
  EXPECT_EQ(entries[2].second, ReadText(folder_ / "next.pub.minisig"));
}

TEST_F(PackageWriterTest, NoDeltaLeadsToAnotherMapOrBack) {
  const auto make = [&](const std::string& name, std::int64_t build, const std::string& map) {
    CraftedBundle b = SmallBundle();
    b.manifest.build = build;
    b.manifest.name = map;
    b.Write(folder_ / name);
    SignBundle(folder_ / name, key_, ReleaseOptions{});
    return folder_ / name;
  };
  const fs::path old = make("old", 2, "city"), moon = make("moon", 3, "moon");
  const fs::path lower = make("lower", 1, "city"), equal = make("equal", 2, "city");
  const auto code = [&](const fs::path& target) {
    try {
      WritePackage(old, target, {}, folder_ / "x.pfb");
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::kOk;
  };
  EXPECT_EQ(code(moon), ErrorCode::kWrongMap);
  EXPECT_EQ(code(lower), ErrorCode::kDowngrade);
  EXPECT_FALSE(fs::exists(folder_ / "x.pfb"));
  EXPECT_EQ(code(equal), ErrorCode::kOk) << "a renewed signature";
}

TEST_F(PackageWriterTest, WhatIsNotSignedOrNotWholeIsNotShipped) {
  const fs::path one = Bundle("one", 1), two = Bundle("two", 2);
  fs::remove(two / kManifestSignatureName);
  EXPECT_THROW(WritePackage(one, two, {}, folder_ / "x.pfb"), Error);
  fs::resize_file(one / "graph.h5", 7);
  EXPECT_THROW(WritePackage({}, one, {}, folder_ / "x.pfb"), Error);
  EXPECT_FALSE(fs::exists(folder_ / "x.pfb"));
  for (const auto& entry : fs::directory_iterator(folder_.path()))
    EXPECT_EQ(entry.path().extension(), "") << "a leftover: " << entry.path();
}

TEST(MakePatch, OnlyWhereItPays) {
  const std::string a = Noise(1), b = Noise(2);
  const auto bytes = [](const std::string& text) {
    return std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  };
  EXPECT_TRUE(MakePatch(bytes(a), bytes(b)).empty());
  EXPECT_LT(MakePatch(bytes(a), bytes(a)).size(), 100U);
  EXPECT_LT(MakePatch(bytes(a + b), bytes(b + "x" + a)).size(), 200U) << "moved";
  EXPECT_FALSE(MakePatch(bytes(""), bytes(std::string(10000, 'x'))).empty());
  EXPECT_TRUE(MakePatch(bytes(a), bytes("")).empty() || MakePatch(bytes(a), bytes("")).size() < 20);
}

}  // namespace
}  // namespace panofix
