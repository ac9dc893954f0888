#include "tests/e2e/data_set.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace panofix::e2e {

namespace fs = std::filesystem;

TownData::TownData(const std::vector<std::string>& options) {
  std::vector<std::string> arguments{"--out", town().string()};
  arguments.insert(arguments.end(), options.begin(), options.end());
  const Outcome outcome = RunProgram(TownCommand(arguments));
  EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
}

Outcome TownData::Build(const fs::path& panoramas, const fs::path& out,
                        const std::vector<std::string>& options) const {
  std::vector<std::string> arguments{
      "build", "--panoramas", panoramas.string(), "--camera", camera().string(),
      "--out", out.string(),  "--sift-words",     "500",      "--mser-words",
      "200"};
  const auto given = [&](const char* option) {
    return std::find(options.begin(), options.end(), option) != options.end();
  };
  // Rendered views are slow: fewer of them, unless the test says otherwise.
  if (!given("--station-spacing-m") && !given("--preset"))
    arguments.insert(arguments.end(), {"--station-spacing-m", "5"});
  if (!given("--work")) arguments.insert(arguments.end(), {"--work", (root() / "work").string()});
  arguments.insert(arguments.end(), options.begin(), options.end());
  return Builder(arguments);
}

Outcome TownData::Localize(const fs::path& bundle, const fs::path& drive, const fs::path& out,
                           const std::vector<std::string>& options) const {
  std::vector<std::string> arguments{"localize",     "--bundle", bundle.string(), "--drive",
                                     drive.string(), "--out",    out.string()};
  arguments.insert(arguments.end(), options.begin(), options.end());
  return Runtime(arguments);
}

std::vector<std::string> EasyTown() {
  return {"--seed",
          "4",
          "--panoramas",
          "4",
          "--spacing-m",
          "8",
          "--pano-width-px",
          "1600",
          "--frames",
          "4",
          "--frame-width-px",
          "400",
          "--frame-height-px",
          "300",
          "--same-light"};
}

Json ReadJson(const fs::path& path) {
  const Json json = Json::parse(ReadText(path), nullptr, false);
  EXPECT_FALSE(json.is_discarded()) << path;
  return json;
}

fs::path WriteDataSet(const TownData& data, const std::string& name, const Json& collection) {
  WriteText(data.town() / name, collection.dump(1) + "\n");
  return data.town() / name;
}

fs::path CopyFolder(const fs::path& from, const fs::path& to) {
  fs::remove_all(to);
  fs::copy(from, to, fs::copy_options::recursive);
  return to;
}

void FlipMiddleByte(const fs::path& path) {
  std::string bytes = ReadText(path);
  ASSERT_FALSE(bytes.empty()) << path;
  char& byte = bytes[bytes.size() / 2];
  byte = static_cast<char>(byte ^ 1);
  WriteText(path, bytes);
}

void ReplaceInFile(const fs::path& path, const std::string& from, const std::string& to) {
  std::string text = ReadText(path);
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << path << " has no '" << from << "'";
  WriteText(path, text.replace(at, from.size(), to));
}

void TruncateFile(const fs::path& path, double share) {
  fs::resize_file(path,
                  static_cast<std::uintmax_t>(share * static_cast<double>(fs::file_size(path))));
}

}  // namespace panofix::e2e
