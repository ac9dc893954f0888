#include "tests/rules/source_tree.h"

#include <algorithm>
#include <fstream>
#include <regex>

namespace panofix {
namespace {

namespace fs = std::filesystem;

bool Under(const std::string& path, const std::string& folder) {
  return path.rfind(folder + "/", 0) == 0;
}

bool IsHeader(const std::string& path) { return path.ends_with(".h"); }
bool IsCpp(const std::string& path) { return IsHeader(path) || path.ends_with(".cc"); }
bool IsCMake(const std::string& path) {
  return path.ends_with("CMakeLists.txt") || path.ends_with(".cmake") ||
         path.ends_with("CMakePresets.json");
}
bool IsProduct(const std::string& path) {
  return Under(path, "common") || Under(path, "builder") || Under(path, "runtime");
}
bool IsLibrary(const std::string& path) {
  return IsProduct(path) && path.find("/app/") == std::string::npos;
}

std::string Fault(const SourceFile& file, std::size_t line, const std::string& text) {
  return file.path + ":" + std::to_string(line) + ": " + text;
}

// The code of a line: no line comment, and string literals emptied.
std::string CodeOf(const std::string& line) {
  static const std::regex literal(R"("(\\.|[^"\\])*")");
  const std::string code = std::regex_replace(line, literal, "\"\"");
  return code.substr(0, code.find("//"));
}

Faults MatchingLines(const SourceFile& file, const std::regex& pattern, const std::string& text) {
  Faults faults;
  for (std::size_t i = 0; i < file.lines.size(); ++i) {
    if (std::regex_search(CodeOf(file.lines[i]), pattern)) {
      faults.push_back(Fault(file, i + 1, text));
    }
  }
  return faults;
}

// A third-party header, by prefix, and the folders that may include it.
struct Door {
  const char* header;
  std::vector<const char*> folders;
};

const std::vector<Door>& Doors() {
  static const std::vector<Door> doors{
      {"opencv2/", {"common", "builder", "runtime", "tests"}},
      {"Eigen/", {"common", "builder", "runtime", "tests"}},
      {"nlohmann/", {"common", "builder", "runtime", "tests"}},
      {"openssl/", {"common", "builder", "runtime", "tests"}},
      {"ceres/", {"builder", "tests"}},
      {"tbb/", {"common", "builder", "runtime", "tests"}},
      {"omp.h", {"common", "builder", "tests"}},
      {"zlib.h", {"common/image", "builder", "tests"}},
      {"jpeglib.h", {"common/image"}},
      {"jerror.h", {"common/image"}},
      {"CLI/", {"builder/app", "runtime/app", "tests"}},
      {"zmq", {"runtime", "tests/runtime", "tests/e2e"}},
      {"flatbuffers/", {"runtime", "tests/runtime", "tests/e2e"}},
      {"spdlog/", {"common/base"}},
      {"hdf5.h", {"common/io", "tests/common/io"}},
      {"GeographicLib/", {"common/geo", "tests/common/geo", "tests/town"}},
      {"yaml-cpp/", {"common/camera"}},
      {"embree3/", {"tests/town"}},
      {"sodium.h", {"common/sign", "builder/ship", "tests/support"}},
      {"zstd.h", {"builder/ship", "runtime/store", "tests/runtime", "tests/builder"}},
      {"curl/", {"runtime/store"}},
      {"httplib.h", {"runtime/monitor", "tests/runtime", "tests/e2e"}},
      {"gtest/", {"tests"}},
      {"gmock/", {"tests"}},
      {"benchmark/", {"tests/bench"}}};
  return doors;
}

// The C library, the kernel and the processor: no third party.
bool IsPlatformHeader(const std::string& target) {
  static const std::regex platform(
      R"(^((sys|netinet|arpa|linux)/.*|(unistd|fcntl|poll|spawn|signal|stdlib|string|time|errno|dirent|dlfcn|stdarg|pthread|sched|glob|netdb|malloc|termios|cpuid|[a-z]*intrin)\.h)$)");
  return target.find_first_of("./") == std::string::npos || std::regex_match(target, platform);
}

}  // namespace

std::string FolderOf(const std::string& path) {
  const auto slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

std::vector<SourceFile> ReadSourceTree(const fs::path& root) {
  std::vector<fs::path> paths{root / "CMakeLists.txt", root / "CMakePresets.json"};
  for (const char* folder : {"common", "builder", "runtime", "tests", "schemas"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string name = entry.path().filename().string();
      if (IsCpp(name) || IsCMake(name) || name.ends_with(".fbs")) paths.push_back(entry.path());
    }
  }
  std::sort(paths.begin(), paths.end());
  std::vector<SourceFile> files;
  for (const fs::path& path : paths) {
    SourceFile file{path.lexically_relative(root).string(), {}};
    std::ifstream in(path);
    for (std::string line; std::getline(in, line);) file.lines.push_back(line);
    files.push_back(std::move(file));
  }
  return files;
}

std::vector<Include> IncludesOf(const SourceFile& file) {
  static const std::regex pattern(R"(^\s*#\s*include\s*(["<])([^">]+)[">])");
  std::vector<Include> includes;
  std::smatch match;
  for (std::size_t i = 0; i < file.lines.size(); ++i) {
    if (std::regex_search(file.lines[i], match, pattern)) {
      includes.push_back({match[2], match[1] == "\"", i + 1});
    }
  }
  return includes;
}

Faults IncludeDirection(const SourceFile& file) {
  Faults faults;
  bool has_builder = Under(file.path, "builder") || Under(file.path, "tests/builder");
  bool has_runtime = Under(file.path, "runtime") || Under(file.path, "tests/runtime");
  const bool is_common = Under(file.path, "common") || Under(file.path, "tests/common");
  for (const Include& include : IncludesOf(file)) {
    const bool to_builder = Under(include.target, "builder");
    const bool to_runtime = Under(include.target, "runtime");
    if (is_common && (to_builder || to_runtime)) {
      faults.push_back(
          Fault(file, include.line,
                "common includes " + include.target + "; move what both need into common"));
    }
    if (IsProduct(file.path) && Under(include.target, "tests")) {
      faults.push_back(
          Fault(file, include.line, "product code includes " + include.target + "; move it out"));
    }
    has_builder |= to_builder, has_runtime |= to_runtime;
    if (has_builder && has_runtime && (to_builder || to_runtime) &&
        !Under(file.path, "tests/e2e")) {
      faults.push_back(
          Fault(file, include.line,
                "builder and runtime meet at " + include.target + "; only tests/e2e may use both"));
    }
  }
  return faults;
}

Faults IncludesFromRoot(const SourceFile& file, const fs::path& root) {
  Faults faults;
  for (const Include& include : IncludesOf(file)) {
    const bool generated = include.target.ends_with("_generated.h");
    if (include.quoted && !generated && !fs::is_regular_file(root / include.target)) {
      faults.push_back(Fault(file, include.line,
                             "\"" + include.target +
                                 "\" is no file of the tree; write it from "
                                 "the root, system headers in <>"));
    }
  }
  return faults;
}

Faults ThirdPartyIncludes(const SourceFile& file) {
  Faults faults;
  if (!IsCpp(file.path)) return faults;
  for (const Include& include : IncludesOf(file)) {
    if (include.quoted || IsPlatformHeader(include.target)) continue;
    const auto door = std::find_if(Doors().begin(), Doors().end(), [&](const Door& d) {
      return include.target.rfind(d.header, 0) == 0;
    });
    const bool allowed = door != Doors().end() &&
                         std::any_of(door->folders.begin(), door->folders.end(),
                                     [&](const char* folder) { return Under(file.path, folder); });
    if (!allowed) {
      faults.push_back(Fault(file, include.line,
                             "<" + include.target +
                                 "> may not be used here; go through the "
                                 "module that owns it (table in this test)"));
    }
  }
  return faults;
}

Faults HeaderGuard(const SourceFile& file) {
  if (!IsHeader(file.path) || (!file.lines.empty() && file.lines[0] == "#pragma once")) return {};
  return {Fault(file, 1, "the first line is not #pragma once; put it there")};
}

Faults NoPrinting(const SourceFile& file) {
  static const std::regex pattern(
      R"(\bstd::(cout|cerr|clog)\b|(^|[^\w])(printf|puts|putchar)\s*\()");
  if (!IsLibrary(file.path) || !IsCpp(file.path)) return {};
  return MatchingLines(file, pattern, "a library prints; log it or return it");
}

Faults NoFloatEquality(const SourceFile& file) {
  // Zero is exact and a common guard; any other decimal literal is a rounding accident waiting.
  static const std::regex pattern(
      R"([=!]=\s*-?(?!0*\.0*[fF]?(?![\w.]))(\d+\.\d*|\.\d+)([eE][-+]?\d+)?[fF]?)");
  if (!IsProduct(file.path) || !IsCpp(file.path)) return {};
  return MatchingLines(file, pattern, "compares with a decimal literal; give a tolerance");
}

Faults NoOpenEnds(const SourceFile& file) {
  static const std::regex pattern(R"(\b(TO)(DO)\b|\b(FIX)(ME)\b|\bX(X)X\b)");
  Faults faults;
  for (std::size_t i = 0; i < file.lines.size(); ++i) {
    if (std::regex_search(file.lines[i], pattern)) {
      faults.push_back(Fault(file, i + 1, "an open end; do it or file it"));
    }
  }
  return faults;
}

Faults FileLength(const SourceFile& file) {
  constexpr std::size_t kMostLines = 400, kReasonWithin = 5;
  if (!IsCpp(file.path) || file.lines.size() <= kMostLines) return {};
  for (std::size_t i = 0; i < kReasonWithin; ++i) {
    if (file.lines[i].rfind("// Long:", 0) == 0) return {};
  }
  return {Fault(file, file.lines.size(),
                "longer than 400 lines; split it, or say why in a '// Long:' line at its head")};
}

Faults CMakeHygiene(const SourceFile& file) {
  static const std::regex pattern(
      R"(-march=native|-mtune=native|-ffast-math|-Ofast|-funsafe-math|FetchContent|ExternalProject|file\s*\(\s*(GLOB|DOWNLOAD))");
  Faults faults;
  for (std::size_t i = 0; IsCMake(file.path) && i < file.lines.size(); ++i) {
    const std::string code = file.lines[i].substr(0, file.lines[i].find('#'));
    if (std::regex_search(code, pattern)) {
      faults.push_back(Fault(file, i + 1, "forbidden in the build; see the style on equal bytes"));
    }
  }
  return faults;
}

Faults SecretKeys(const fs::path& root) {
  static const std::regex secret(R"(^untrusted comment: .*secret key)");
  Faults faults;
  for (auto entry = fs::recursive_directory_iterator(root); entry != fs::end(entry); ++entry) {
    const fs::path path = entry->path().lexically_relative(root);
    if (entry->is_directory()) {
      if (path == "build" || path == "out" || path == ".git" || path == ".cache")
        entry.disable_recursion_pending();
      continue;
    }
    std::ifstream in(entry->path());
    std::string first(200, '\0');
    in.read(first.data(), static_cast<std::streamsize>(first.size()));
    if (path.extension() == ".key" || std::regex_search(first, secret))
      faults.push_back(path.string() +
                       ":1: a secret key; keep it out of the tree, use another one");
  }
  return faults;
}

Faults ModuleRings(const std::vector<SourceFile>& files) {
  std::map<std::string, std::map<std::string, std::string>> uses;  // folder -> folder -> where
  for (const SourceFile& file : files) {
    if (!IsProduct(file.path)) continue;
    for (const Include& include : IncludesOf(file)) {
      const std::string from = FolderOf(file.path), to = FolderOf(include.target);
      if (include.quoted && IsProduct(include.target) && from != to) {
        uses[from].emplace(to, Fault(file, include.line, "includes " + include.target));
      }
    }
  }
  // Folders that use nothing but peeled ones are peeled off; what stays is in or above a ring.
  for (bool peeled = true; peeled;) {
    peeled = false;
    for (auto it = uses.begin(); it != uses.end();) {
      std::erase_if(it->second, [&](const auto& use) { return !uses.contains(use.first); });
      peeled |= it->second.empty();
      it = it->second.empty() ? uses.erase(it) : std::next(it);
    }
  }
  Faults faults;
  for (const auto& [folder, targets] : uses) {
    for (const auto& [target, where] : targets) {
      faults.push_back(where + ", on a ring of folders; let one side own what both need");
    }
  }
  return faults;
}

}  // namespace panofix
