#include "tests/e2e/staged_build.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/base/rng.h"

namespace panofix::e2e {

namespace fs = std::filesystem;

std::vector<StageCall> StageCalls(const fs::path& work, std::uint64_t shuffle_seed) {
  const Json plan = ReadJson(work / "plan.json");
  Rng rng(shuffle_seed, "tests/stages");
  std::vector<StageCall> calls;
  const auto add = [&](const std::vector<std::string>& stages, const char* units,
                       const char* option) {
    std::vector<StageCall> some;
    for (const std::string& stage : stages) {
      for (const auto& [unit, unused] : plan[units].items()) some.push_back({stage, option, unit});
    }
    for (std::size_t i = some.size(); i > 1; --i) std::swap(some[i - 1], some[rng.Below(i)]);
    calls.insert(calls.end(), some.begin(), some.end());
  };
  const bool trains = plan["vocabulary_sha256"] == "";
  add({"extract"}, "shards", "--shard");
  if (trains) {
    add({"augment", "sample"}, "shards", "--shard");
  } else {
    add({"augment"}, "shards", "--shard");
  }
  calls.push_back({"train"});
  add({"words"}, "shards", "--shard");
  calls.push_back({"weigh"});
  add({"landmarks", "similarity"}, "tiles", "--tile");
  calls.push_back({"assemble"});
  calls.push_back({"publish"});
  return calls;
}

Files ReadTree(const fs::path& root) {
  Files files;
  for (const auto& entry : fs::recursive_directory_iterator(root)) {
    if (entry.is_regular_file()) {
      files[entry.path().lexically_relative(root).string()] = ReadText(entry.path());
    }
  }
  return files;
}

void ExpectSameFiles(const Files& files, const Files& reference) {
  ASSERT_EQ(files.size(), reference.size());
  for (const auto& [path, bytes] : reference) {
    ASSERT_TRUE(files.contains(path)) << path;
    EXPECT_TRUE(files.at(path) == bytes) << path << " differs";
  }
}

}  // namespace panofix::e2e
