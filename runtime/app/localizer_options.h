#pragma once
// Command-line options of the localizer, alike wherever it runs.

#include <filesystem>
#include <vector>

#include "runtime/localizer/localizer.h"

namespace CLI {
class App;
}

namespace panofix {

// --preset, --add, --threads, --memory-mb, --seed.
void AddLocalizerOptions(CLI::App* command, LocalizerOptions* options);
// --trusted-key: files of public keys; ReadKeyRing reads them once the command line is.
void AddTrustedKeyOption(CLI::App* command, std::vector<std::filesystem::path>* keys);

}  // namespace panofix
