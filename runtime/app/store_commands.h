#pragma once
// The subcommands around a vehicle's store of maps: verify, init, trust, revoke, install, activate,
// rollback, list, gc, fsck.

#include <functional>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace CLI {
class App;
}

namespace panofix {

// What a parsed subcommand runs.
using StoreCommand = std::pair<CLI::App*, std::function<Status()>>;

[[nodiscard]] std::vector<StoreCommand> AddStoreCommands(CLI::App* app);

}  // namespace panofix
