#pragma once
// Seconds since 1970 UTC as text: 2026-11-22T09:30:00Z.

#include <cstdint>
#include <optional>
#include <string>

namespace panofix {

// Years 1970 to 9999; others are clamped.
[[nodiscard]] std::string FormatUtc(std::int64_t time_s);
// Exactly that form and a real date; nullopt otherwise.
[[nodiscard]] std::optional<std::int64_t> ParseUtc(const std::string& text);
// The system's clock.
[[nodiscard]] std::int64_t NowUtc_s();

}  // namespace panofix
