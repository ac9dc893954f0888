#pragma once
// The subcommands around the live feed: serve, play, record, wire-key.

#include <vector>

#include "runtime/app/store_commands.h"

namespace panofix {

[[nodiscard]] std::vector<StoreCommand> AddServiceCommands(CLI::App* app);

}  // namespace panofix
