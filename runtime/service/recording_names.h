#pragma once
// Names of the metadata in a recording; schemas/messages.md tells their meaning.

namespace panofix::recording {

inline constexpr const char* kOptions = "panofix.options";
inline constexpr const char* kPreset = "preset";
inline constexpr const char* kAdd = "add";
inline constexpr const char* kSeed = "seed";
inline constexpr const char* kMap = "panofix.map";
inline constexpr const char* kMapName = "name";
inline constexpr const char* kMapId = "id";
inline constexpr const char* kMapBuild = "build";
inline constexpr const char* kDeadline = "panofix.deadline";
inline constexpr const char* kGap = "panofix.gap";
inline constexpr const char* kStep = "step";

}  // namespace panofix::recording
