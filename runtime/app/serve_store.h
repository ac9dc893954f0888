#pragma once
// The service over a vehicle's store instead of a bundle's folder.

#include <filesystem>

#include "runtime/service/serve.h"

namespace panofix {

// Serves the active version of the store, signature and hashes verified with the store's keys. An
// activation that a power cut interrupted is probed first. Where the active version does not open,
// the one before is served, then any other that is whole, with an error in the log: a vehicle is
// not left without a map while there is one. One that has expired is served with a warning. What is
// activated later (or rolled back to) is opened beside the map in use and takes over between
// frames. An active version that does not open is tried again now and then. `options.bundle` and
// `options.localizer.trusted_keys` are set here.
[[nodiscard]] Status ServeStore(const std::filesystem::path& store, ServeOptions options);

}  // namespace panofix
