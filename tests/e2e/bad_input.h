#pragma once
// What the tests of bad input share: one small town with its map, and what a refusal looks like.

#include <filesystem>
#include <string>
#include <vector>

#include "tests/e2e/data_set.h"

namespace panofix::e2e {

inline constexpr std::size_t kNumBadInputPanoramas = 5, kNumBadInputFrames = 2;

struct BadInputData {
  TownData data;
  std::filesystem::path bundle;  // of all panoramas; not to be damaged
};

// Rendered and built at the first call.
[[nodiscard]] const BadInputData& SharedData();

// The program ended with `exit_code` and one line on stderr (progress aside) that starts with the
// program's name and holds every word: the file, the fault and the mend.
void ExpectRefused(const Outcome& outcome, int exit_code, const std::vector<std::string>& words);

// sysexits.h, as the programs' help lists them.
inline constexpr int kWrongUse = 64, kBadData = 65, kNotFound = 66, kDisk = 74, kBadVersion = 76;

}  // namespace panofix::e2e
