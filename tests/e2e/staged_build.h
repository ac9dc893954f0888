#pragma once
// A build by its stages, each a program of its own, as an engine would run it.

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "tests/e2e/data_set.h"

namespace panofix::e2e {

// One call of a stage: its arguments without --work.
using StageCall = std::vector<std::string>;

// The calls after `plan`, in an order that respects their needs; within a stage the units come in
// the order of `shuffle_seed`.
[[nodiscard]] std::vector<StageCall> StageCalls(const std::filesystem::path& work,
                                                std::uint64_t shuffle_seed);

// Files of a folder, bytes by path.
using Files = std::map<std::string, std::string>;
[[nodiscard]] Files ReadTree(const std::filesystem::path& root);
// Test failures that name the files that differ.
void ExpectSameFiles(const Files& files, const Files& reference);

}  // namespace panofix::e2e
