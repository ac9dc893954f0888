#pragma once
// The builder's subcommands: each adds its options to the app and returns what to run once parsed.

#include <functional>
#include <vector>

namespace CLI {
class App;
}

namespace panofix {

// Returns the exit code; throws Error.
using Command = std::function<int()>;

Command AddBuildCommand(CLI::App* app);
Command AddDepthCommand(CLI::App* app);
Command AddInspectCommand(CLI::App* app);
Command AddValidateCommand(CLI::App* app);
Command AddPlanCommand(CLI::App* app);
Command AddScoreCommand(CLI::App* app);
Command AddKeygenCommand(CLI::App* app);
Command AddEndorseCommand(CLI::App* app);
Command AddSignCommand(CLI::App* app);
Command AddDeltaCommand(CLI::App* app);
Command AddPackCommand(CLI::App* app);
Command AddMigrateCommand(CLI::App* app);
// extract, augment, sample, train, words, weigh, landmarks, similarity, assemble, publish.
std::vector<Command> AddStageCommands(CLI::App* app);

}  // namespace panofix
