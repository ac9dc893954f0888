#pragma once
// The log: one line an event, on standard error. A thin door, so that spdlog is compiled once.

#include <string>
#include <string_view>

namespace panofix {

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

// Takes the level's name (debug, info, warning, error, off); false where the name is unknown.
bool SetLogLevel(std::string_view name);
void Log(LogLevel level, const std::string& message);
inline void LogDebug(const std::string& message) { Log(LogLevel::kDebug, message); }
inline void LogInfo(const std::string& message) { Log(LogLevel::kInfo, message); }
inline void LogWarning(const std::string& message) { Log(LogLevel::kWarning, message); }

// printf-style formatting; g++ 12 has no <format>.
std::string Format(const char* format, ...) __attribute__((format(printf, 1, 2)));

}  // namespace panofix
