#pragma once
// Whether a bundle runs on this machine.

#include "runtime/store/activate.h"

namespace panofix {

// Opens the bundle as `serve` would, its signature checked with the store's keys, and localizes one
// empty frame of its own camera: in a child process, for at most `timeout_s`.
[[nodiscard]] HealthProbe MakeHealthProbe(const StoreLayout& layout, double timeout_s);

}  // namespace panofix
