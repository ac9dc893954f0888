#include "common/sign/utc_time.h"

#include <time.h>

#include <algorithm>
#include <chrono>

#include "common/base/log.h"

namespace panofix {

std::string FormatUtc(std::int64_t time_s) {
  constexpr std::int64_t kEndOf9999_s = 253402300799;
  const time_t time = std::clamp<std::int64_t>(time_s, 0, kEndOf9999_s);
  struct tm utc {};
  ::gmtime_r(&time, &utc);
  return Format("%04d-%02d-%02dT%02d:%02d:%02dZ", utc.tm_year + 1900, utc.tm_mon + 1, utc.tm_mday,
                utc.tm_hour, utc.tm_min, utc.tm_sec);
}

std::optional<std::int64_t> ParseUtc(const std::string& text) {
  constexpr char kPattern[] = "0000-00-00T00:00:00Z";
  if (text.size() != sizeof kPattern - 1) return std::nullopt;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool is_digit = text[i] >= '0' && text[i] <= '9';
    if (kPattern[i] == '0' ? !is_digit : text[i] != kPattern[i]) return std::nullopt;
  }
  struct tm utc {};
  utc.tm_year = std::stoi(text.substr(0, 4)) - 1900, utc.tm_mon = std::stoi(text.substr(5, 2)) - 1;
  utc.tm_mday = std::stoi(text.substr(8, 2)), utc.tm_hour = std::stoi(text.substr(11, 2));
  utc.tm_min = std::stoi(text.substr(14, 2)), utc.tm_sec = std::stoi(text.substr(17, 2));
  const std::int64_t time_s = ::timegm(&utc);
  // The 31st of February comes back as a day of March; times before 1970 as 1970.
  if (FormatUtc(time_s) != text) return std::nullopt;
  return time_s;
}

std::int64_t NowUtc_s() {
  return std::chrono::duration_cast<std::chrono::seconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace panofix
