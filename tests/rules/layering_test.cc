// Every rule twice: on the tree as it is, and on planted text, so that a rule cannot sleep.
#include <gtest/gtest.h>

#include <functional>

#include "tests/common/io/temp_folder.h"
#include "tests/rules/source_tree.h"

namespace panofix {
namespace {

const std::filesystem::path kRoot = PANOFIX_SOURCE_DIR;

const std::vector<SourceFile>& Tree() {
  static const std::vector<SourceFile> tree = ReadSourceTree(kRoot);
  return tree;
}

void ExpectNone(const Faults& faults) {
  for (const std::string& fault : faults) ADD_FAILURE() << fault;
}

void ExpectTreeKeeps(const std::function<Faults(const SourceFile&)>& rule) {
  for (const SourceFile& file : Tree()) ExpectNone(rule(file));
}

SourceFile Planted(const std::string& path, std::vector<std::string> lines) {
  return {path, std::move(lines)};
}

Faults FromRoot(const SourceFile& file) { return IncludesFromRoot(file, kRoot); }

TEST(Rules, TheTreeIsRead) {
  EXPECT_GT(Tree().size(), 50U);
  std::size_t num_includes = 0;
  for (const SourceFile& file : Tree()) num_includes += IncludesOf(file).size();
  EXPECT_GT(num_includes, 100U);
}

TEST(Rules, IncludeDirection) {
  ExpectTreeKeeps(IncludeDirection);
  const std::string to_builder = "#include \"builder/ingest/depth_map.h\"";
  const std::string to_runtime = "  #  include \"runtime/localizer/localizer.h\"";
  EXPECT_EQ(IncludeDirection(Planted("common/io/a.cc", {to_builder})).size(), 1U);
  EXPECT_EQ(IncludeDirection(Planted("tests/common/io/a.cc", {to_runtime})).size(), 1U);
  EXPECT_EQ(IncludeDirection(Planted("runtime/pose/a.h", {to_builder})).size(), 1U);
  EXPECT_EQ(IncludeDirection(Planted("builder/app/a.h", {to_runtime})).size(), 1U);
  EXPECT_EQ(IncludeDirection(Planted("tests/town/a.cc", {to_runtime, to_builder})).size(), 1U);
  EXPECT_EQ(IncludeDirection(Planted("builder/x/a.cc", {"#include \"tests/town/t.h\""})).size(),
            1U);
  ExpectNone(IncludeDirection(Planted("tests/e2e/a.cc", {to_runtime, to_builder})));
  ExpectNone(IncludeDirection(Planted("builder/app/a.cc", {to_builder})));
}

TEST(Rules, IncludesAreWrittenFromTheRoot) {
  ExpectTreeKeeps(FromRoot);
  EXPECT_EQ(FromRoot(Planted("common/io/a.cc", {"#include \"sha256.h\""})).size(), 1U);
  EXPECT_EQ(FromRoot(Planted("common/io/a.cc", {"#include \"../io/sha256.h\""})).size(), 1U);
  ExpectNone(FromRoot(Planted("common/io/a.cc", {"#include \"common/io/sha256.h\""})));
}

TEST(Rules, ThirdPartyGoesThroughItsDoors) {
  ExpectTreeKeeps(ThirdPartyIncludes);
  const auto num_faults = [](const std::string& path, const std::string& header) {
    return ThirdPartyIncludes(Planted(path, {"#include <" + header + ">"})).size();
  };
  EXPECT_EQ(num_faults("runtime/pose/a.cc", "boost/any.hpp"), 1U);
  EXPECT_EQ(num_faults("runtime/pose/a.cc", "hdf5.h"), 1U);
  EXPECT_EQ(num_faults("runtime/pose/a.cc", "jpeglib.h"), 1U);
  EXPECT_EQ(num_faults("runtime/pose/a.cc", "CLI/CLI.hpp"), 1U);
  EXPECT_EQ(num_faults("builder/publish/a.cc", "GeographicLib/Geocentric.hpp"), 1U);
  EXPECT_EQ(num_faults("common/io/a.cc", "spdlog/spdlog.h"), 1U);
  EXPECT_EQ(num_faults("builder/app/main.cc", "gtest/gtest.h"), 1U);
  EXPECT_EQ(num_faults("runtime/pose/a.cc", "opencv2/core.hpp"), 0U);
  EXPECT_EQ(num_faults("runtime/app/main.cc", "CLI/CLI.hpp"), 0U);
  EXPECT_EQ(num_faults("common/io/a.cc", "hdf5.h"), 0U);
  EXPECT_EQ(num_faults("runtime/service/a.cc", "sys/mman.h"), 0U);
  EXPECT_EQ(num_faults("runtime/service/a.cc", "vector"), 0U);
}

TEST(Rules, HeadersGuardThemselves) {
  ExpectTreeKeeps(HeaderGuard);
  EXPECT_EQ(HeaderGuard(Planted("common/io/a.h", {"// late", "#pragma once"})).size(), 1U);
  EXPECT_EQ(HeaderGuard(Planted("common/io/a.h", {})).size(), 1U);
  ExpectNone(HeaderGuard(Planted("common/io/a.cc", {"int x;"})));
}

TEST(Rules, LibrariesDoNotPrint) {
  ExpectTreeKeeps(NoPrinting);
  EXPECT_EQ(NoPrinting(Planted("common/io/a.cc", {"std::cout << 1;"})).size(), 1U);
  EXPECT_EQ(NoPrinting(Planted("builder/train/a.cc", {"  printf(\"x\");"})).size(), 1U);
  ExpectNone(NoPrinting(Planted("common/io/a.cc", {"// std::cout", "f(\"std::cout\");"})));
  ExpectNone(NoPrinting(Planted("common/io/a.cc", {"std::snprintf(a, 1, \"\");"})));
  ExpectNone(NoPrinting(Planted("runtime/app/main.cc", {"std::cout << 1;"})));
}

TEST(Rules, DecimalsAreNotComparedForEquality) {
  ExpectTreeKeeps(NoFloatEquality);
  EXPECT_EQ(NoFloatEquality(Planted("common/io/a.cc", {"if (x == 0.5) {"})).size(), 1U);
  EXPECT_EQ(NoFloatEquality(Planted("common/io/a.cc", {"if (x != -1.0f) {"})).size(), 1U);
  ExpectNone(NoFloatEquality(Planted("common/io/a.cc", {"if (x == 0.0) {", "y = 0.5;"})));
  ExpectNone(NoFloatEquality(Planted("common/io/a.cc", {"if (n == 10) {", "x <= 0.5;"})));
}

TEST(Rules, NothingIsLeftOpen) {
  ExpectTreeKeeps(NoOpenEnds);
  EXPECT_EQ(NoOpenEnds(Planted("common/io/a.cc", {std::string("// TO") + "DO: later"})).size(), 1U);
}

TEST(Rules, FilesStaySmall) {
  ExpectTreeKeeps(FileLength);
  std::vector<std::string> lines(401, "int x;");
  EXPECT_EQ(FileLength(Planted("common/io/a.cc", lines)).size(), 1U);
  lines[1] = "// Long: one table";
  ExpectNone(FileLength(Planted("common/io/a.cc", lines)));
  lines.assign(400, "int x;");
  ExpectNone(FileLength(Planted("common/io/a.cc", lines)));
}

TEST(Rules, TheBuildIsTheSameEverywhere) {
  ExpectTreeKeeps(CMakeHygiene);
  EXPECT_EQ(CMakeHygiene(Planted("common/CMakeLists.txt", {"add(-march=native)"})).size(), 1U);
  EXPECT_EQ(CMakeHygiene(Planted("a.cmake", {"file(GLOB x *.cc)"})).size(), 1U);
  ExpectNone(CMakeHygiene(Planted("a.cmake", {"# never -ffast-math"})));
}

TEST(Rules, NoSecretKeyIsInTheTree) {
  ExpectNone(SecretKeys(kRoot));
  const TempFolder folder;
  WriteText(folder / "map.pub", "untrusted comment: minisign public key 0\nRWQ\n");
  WriteText(folder / "build" / "map.key", "left by a test");
  ExpectNone(SecretKeys(folder.path()));
  WriteText(folder / "a" / "map.key", "x");
  WriteText(folder / "a" / "other.txt", "untrusted comment: minisign encrypted secret key\nRW\n");
  EXPECT_EQ(SecretKeys(folder.path()).size(), 2U);
}

TEST(Rules, ModulesFormNoRing) {
  ExpectNone(ModuleRings(Tree()));
  const std::vector<SourceFile> ring{
      Planted("common/a/x.h", {"#include \"common/b/x.h\""}),
      Planted("common/b/x.h", {"#include \"common/c/x.h\"", "#include \"common/d/x.h\""}),
      Planted("common/c/x.h", {"#include \"common/a/x.h\""}), Planted("common/d/x.h", {"int x;"})};
  EXPECT_EQ(ModuleRings(ring).size(), 3U);
  EXPECT_TRUE(ModuleRings({ring[0], ring[1], ring[3]}).empty());
}

}  // namespace
}  // namespace panofix
