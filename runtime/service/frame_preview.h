#pragma once
// A raw frame as a picture that browsers can show.

#include <cstdint>
#include <vector>

#include "runtime/service/messages.h"

namespace panofix {

// A grey JPEG, its longer side at most 1280 px, whatever the frame's size: some milliseconds. Empty
// where the frame does not convert. Never throws.
[[nodiscard]] std::vector<std::uint8_t> EncodePreview(const IncomingFrame& frame,
                                                      const DecodeLimits& limits);

}  // namespace panofix
