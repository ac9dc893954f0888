#pragma once
// Is this bundle whole, and whose is it? Without a look inside its parts.

#include "runtime/app/store_commands.h"

namespace panofix {

[[nodiscard]] StoreCommand AddVerifyCommand(CLI::App* app);

}  // namespace panofix
