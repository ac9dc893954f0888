#pragma once
// Whole files into memory, with a limit.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace panofix {

// kNotFound, kTooLarge, kIo name the file and the mend.
[[nodiscard]] Result<std::vector<std::uint8_t>> ReadFileBytes(const std::filesystem::path& path,
                                                              std::size_t max_bytes);
[[nodiscard]] Result<std::string> ReadFileText(const std::filesystem::path& path,
                                               std::size_t max_bytes);

}  // namespace panofix
