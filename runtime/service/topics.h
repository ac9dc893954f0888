#pragma once
// Topics and identifiers of the wire: multipart [topic, payload], payloads FlatBuffers of schemas/.

#include <string_view>

namespace panofix {

inline constexpr std::string_view kFrameTopic = "panofix.frame.v1";
inline constexpr std::string_view kCameraTopic = "panofix.camera.v1";
inline constexpr std::string_view kPoseTopic = "panofix.pose.v1";
inline constexpr std::string_view kErrorTopic = "panofix.error.v1";  // plain text
inline constexpr std::string_view kLocationFixTopic = "panofix.location_fix.v1";

}  // namespace panofix
