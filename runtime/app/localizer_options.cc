#include "runtime/app/localizer_options.h"

#include <CLI/CLI.hpp>

#include "runtime/localizer/levers.h"

namespace panofix {

void AddTrustedKeyOption(CLI::App* command, std::vector<std::filesystem::path>* keys) {
  command->add_option("--trusted-key", *keys,
                      "public key that the bundle must be signed with; may be repeated (default: "
                      "the bundle may be unsigned, and every pose says so)");
}

void AddLocalizerOptions(CLI::App* command, LocalizerOptions* options) {
  command
      ->add_option("--preset", options->preset,
                   "default, or paper: the published method, for comparison (its maps too)")
      ->capture_default_str();
  command
      ->add_option(
          "--add", options->add,
          "what the default has over the paper, piece by piece, for ablations:\n" + LeverHelp())
      ->delimiter(',')
      ->type_name("LEVER[,LEVER...]");
  command->add_option("--threads", options->num_threads, "processors to use; 0 = all")
      ->capture_default_str();
  constexpr int kMost_mb = 1 << 20;  // a slip of the keys beyond
  command
      ->add_option_function<std::uint64_t>(
          "--memory-mb", [options](std::uint64_t mb) { options->max_memory_bytes = mb << 20; },
          "what the process may take of memory: tiles far from the vehicle are dropped and read "
          "again when they are wanted; 0 = no bound (default: 0)")
      ->check(CLI::Range(0, kMost_mb));
  command->add_option("--seed", options->seed, "seed of the robust search; same frames, same poses")
      ->capture_default_str();
}

}  // namespace panofix
