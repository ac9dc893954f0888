#pragma once
// The subcommands that read what a service gave: tail, replay.

#include <vector>

#include "runtime/app/store_commands.h"

namespace panofix {

[[nodiscard]] std::vector<StoreCommand> AddStreamCommands(CLI::App* app);

}  // namespace panofix
