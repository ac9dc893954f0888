#pragma once
// The stages of a planned build, one unit at a time. Each reads what earlier ones left in the work
// folder and leaves its own there; run again, it reuses every file whose inputs have not changed.
// Equal inputs give equal files, whatever the shards, so that two that run at once do no harm.

#include <string>

#include "builder/pipeline/build_context.h"
#include "builder/pipeline/run_report.h"
#include "common/base/progress.h"

namespace panofix {

// Runs a stage's unit (a shard's or tile's quadkey, or kAllUnit) and keeps its report in the work
// folder. `progress` counts panoramas and may be null. Throws Error: kTryAgain where an earlier
// stage has not run; kCancelled on Ctrl-C.
UnitReport RunStage(const BuildContext& context, Stage stage, const std::string& unit,
                    Progress* progress = nullptr);

// The stages themselves, called by RunStage: what they did, without times.
namespace stages {
[[nodiscard]] UnitReport Extract(const BuildContext& context, const std::string& shard,
                                 Progress* progress);
[[nodiscard]] UnitReport Augment(const BuildContext& context, const std::string& shard,
                                 Progress* progress);
[[nodiscard]] UnitReport Sample(const BuildContext& context, const std::string& shard);
[[nodiscard]] UnitReport Train(const BuildContext& context);
[[nodiscard]] UnitReport Words(const BuildContext& context, const std::string& shard,
                               Progress* progress);
[[nodiscard]] UnitReport Weigh(const BuildContext& context);
[[nodiscard]] UnitReport Landmarks(const BuildContext& context, const std::string& tile,
                                   Progress* progress);
[[nodiscard]] UnitReport Similarity(const BuildContext& context, const std::string& tile);
[[nodiscard]] UnitReport Assemble(const BuildContext& context);
}  // namespace stages

// The vocabulary of the build, whole: what kWeigh left.
[[nodiscard]] Vocabulary ReadBuildVocabulary(const BuildContext& context, FileReceipt* receipt,
                                             MadeFrom* made_from);

// Publishes what kAssemble put together at `out`, and writes OUT.report.json of all units that ran
// since the plan. Throws Error(kTryAgain) where something is missing or out of date.
RunReport Publish(const BuildContext& context, const std::filesystem::path& out);

}  // namespace panofix
