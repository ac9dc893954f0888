#pragma once
// The project's own sources as text, and the rules on them. A rule answers one line a fault,
// "file:line: fault; mend".

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace panofix {

struct SourceFile {
  std::string path;  // from the root, e.g. "common/io/sha256.cc"
  std::vector<std::string> lines;
};

struct Include {
  std::string target;  // without its quotes or brackets
  bool quoted = false;
  std::size_t line = 0;  // from 1
};

using Faults = std::vector<std::string>;

// Sources, headers, schemas and CMake files under the source folders and the root, sorted by path.
[[nodiscard]] std::vector<SourceFile> ReadSourceTree(const std::filesystem::path& root);
[[nodiscard]] std::vector<Include> IncludesOf(const SourceFile& file);
// "common/io" of "common/io/sha256.cc".
[[nodiscard]] std::string FolderOf(const std::string& path);

// common <- builder, common <- runtime; builder and runtime meet in tests/e2e only; product code
// never includes tests.
[[nodiscard]] Faults IncludeDirection(const SourceFile& file);
// Quoted includes name a file from the root (`root`), or a generated header.
[[nodiscard]] Faults IncludesFromRoot(const SourceFile& file, const std::filesystem::path& root);
// Third-party headers by folder: what the runtime may use at all, and doors with one user.
[[nodiscard]] Faults ThirdPartyIncludes(const SourceFile& file);
[[nodiscard]] Faults HeaderGuard(const SourceFile& file);
// Libraries log and return; only the apps print on standard output.
[[nodiscard]] Faults NoPrinting(const SourceFile& file);
[[nodiscard]] Faults NoFloatEquality(const SourceFile& file);
[[nodiscard]] Faults NoOpenEnds(const SourceFile& file);
[[nodiscard]] Faults FileLength(const SourceFile& file);
// No flags that change results between machines, no globs, no downloads.
[[nodiscard]] Faults CMakeHygiene(const SourceFile& file);
// Secret keys anywhere under `root` but in what builds and git leave there: by name or content.
[[nodiscard]] Faults SecretKeys(const std::filesystem::path& root);
// Folders that include each other in a ring.
[[nodiscard]] Faults ModuleRings(const std::vector<SourceFile>& files);

}  // namespace panofix
