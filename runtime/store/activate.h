#pragma once
// Which version a vehicle runs: put in force by one rename, proven by a probe, taken back where the
// probe fails.

#include <filesystem>
#include <functional>
#include <string>

#include "runtime/store/store.h"

namespace panofix {

// Whether the bundle in this folder runs here.
using HealthProbe = std::function<Status(const std::filesystem::path& folder)>;

// Makes an installed version the active one, then probes it; where that fails (kUnhealthy) all is
// as before: the version in force, and the one to roll back to. `id` is as FindVersion takes it;
// empty means the newest. kDowngrade below the active build, kExpired, kWrongMap, kWrongCamera, and
// what ReadVersion says. Activating the version that is in force and proven does nothing. On
// success the keys that the release revokes are revoked.
[[nodiscard]] Status Activate(const StoreLayout& layout, const std::string& id,
                              const HealthProbe& probe);

// Back to the version that was in force before, which may have expired. kNotFound where there is
// none. The two change places.
[[nodiscard]] Status Rollback(const StoreLayout& layout, const HealthProbe& probe);

// Finishes what a power cut interrupted between activation and probe: probes the active version if
// it is not proven yet, and goes back where it fails. For whoever starts the runtime.
[[nodiscard]] Status SettleActivation(const StoreLayout& layout, const HealthProbe& probe);

// Runs `work` in a child process, so that a crash, a hang or a hunger for memory there does not
// end this one. Its Status comes back; kUnhealthy where it died or took longer than `timeout_s`.
// Call it before this process has threads of its own.
[[nodiscard]] Status RunInChild(const std::function<Status()>& work, double timeout_s);

}  // namespace panofix
