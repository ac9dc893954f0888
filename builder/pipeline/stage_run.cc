// Runs a unit of a stage, timed, and keeps its report.
#include <chrono>
#include <fstream>
#include <stdexcept>

#include "builder/pipeline/stages.h"
#include "common/base/memory.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

UnitReport Call(const BuildContext& context, Stage stage, const std::string& unit,
                Progress* progress) {
  switch (stage) {
    case Stage::kExtract:
      return stages::Extract(context, unit, progress);
    case Stage::kAugment:
      return stages::Augment(context, unit, progress);
    case Stage::kSample:
      return stages::Sample(context, unit);
    case Stage::kTrain:
      return stages::Train(context);
    case Stage::kWords:
      return stages::Words(context, unit, progress);
    case Stage::kWeigh:
      return stages::Weigh(context);
    case Stage::kLandmarks:
      return stages::Landmarks(context, unit, progress);
    case Stage::kSimilarity:
      return stages::Similarity(context, unit);
    case Stage::kAssemble:
      return stages::Assemble(context);
  }
  throw std::logic_error("no such stage");
}

}  // namespace

UnitReport RunStage(const BuildContext& context, Stage stage, const std::string& unit,
                    Progress* progress) {
  const auto start = std::chrono::steady_clock::now();
  UnitReport report = Call(context, stage, unit, progress);
  report.stage = StageName(stage);
  report.unit = unit;
  report.run = ReadRun(context.work);
  report.duration_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  report.peak_memory_bytes = PeakMemoryBytes();
  report.result_sha256 = ReceiptSha256(context.work, stage, unit);
  WriteIfChanged(context.work.report(stage, unit), report.ToJson());
  return report;
}

}  // namespace panofix
