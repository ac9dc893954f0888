#include "builder/pipeline/build.h"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <optional>
#include <thread>

#include "builder/pipeline/stages.h"
#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

fs::path WorkOf(const BuildOptions& options) {
  return options.work.empty() ? fs::path(options.out.string() + ".work") : options.work;
}

bool CountsPanoramas(Stage stage) {
  return stage == Stage::kExtract || stage == Stage::kAugment || stage == Stage::kWords ||
         stage == Stage::kLandmarks;
}

// Units of shards one after the other, each on all threads: one shard in memory at a time.
void RunShards(const BuildContext& context, Stage stage, Progress* progress) {
  for (const auto& [shard, unused] : context.plan.shards) {
    StopIfCancelled();
    (void)RunStage(context, stage, shard, progress);
  }
}

// Tiles beside each other: much of a tile's work is one thread's. A thread that waits inside one
// tile must not start another, or memory would have no bound.
void RunTiles(const BuildContext& context, Stage stage, Progress* progress) {
  std::vector<std::string> tiles;
  for (const auto& [tile, unused] : context.plan.tiles) tiles.push_back(tile);
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, tiles.size(), 1),
      [&](const auto& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          if (CancelRequested()) return;
          tbb::this_task_arena::isolate(
              [&] { (void)RunStage(context, stage, tiles[i], progress); });
        }
      },
      tbb::simple_partitioner());
  StopIfCancelled();
}

void RunAllUnits(const BuildContext& context, Stage stage) {
  StopIfCancelled();
  std::optional<Progress> progress;
  if (CountsPanoramas(stage))
    progress.emplace(StageName(stage), context.plan.num_panoramas(), "panoramas");
  Progress* const shown = progress ? &*progress : nullptr;
  switch (UnitOf(stage)) {
    case StageUnit::kShard:
      RunShards(context, stage, shown);
      break;
    case StageUnit::kTile:
      RunTiles(context, stage, shown);
      break;
    case StageUnit::kAll:
      (void)RunStage(context, stage, kAllUnit);
      break;
  }
  if (progress) progress->Finish();
}

}  // namespace

struct ThreadLimit::Impl {
  tbb::global_control control;
};

ThreadLimit::ThreadLimit(int num_threads)
    : impl_(new Impl{tbb::global_control(tbb::global_control::max_allowed_parallelism,
                                         num_threads > 0 ? static_cast<std::size_t>(num_threads)
                                                         : std::thread::hardware_concurrency())}) {}

ThreadLimit::~ThreadLimit() = default;

void CheckOut(const fs::path& out) {
  ThrowIfError(CheckParentIsWritable(out, "--out"));
  std::error_code ignored;
  if (!fs::exists(out, ignored)) return;
  if (!fs::is_directory(out, ignored)) {
    throw Error(ErrorCode::kInvalidArgument, out.string() + ": is a file; name a folder for --out");
  }
  if (fs::is_empty(out, ignored) || fs::exists(out / kManifestHashName, ignored)) return;
  throw Error(ErrorCode::kInvalidArgument,
              out.string() +
                  ": a folder that holds something else than a bundle; it would be "
                  "replaced: choose another --out, or remove it yourself");
}

void PlanBuild(BuildOptions options) {
  const auto start = std::chrono::steady_clock::now();
  options.Check();
  CheckOut(options.out);
  if (options.map_frame != "tangent") {
    const auto known = MapFrame::FromName(options.map_frame);
    if (!known.ok()) throw Error(ErrorCode::kInvalidArgument, known.status().message());
  }
  options.work = WorkOf(options);
  const BuildPlan plan = MakePlan(options);
  const WorkFolder work(options.work);
  RemoveStale(work, options.out);
  UnitReport report;
  report.stage = "plan", report.unit = kAllUnit;
  report.run = StartRun(work);
  report.num_items = report.num_new = plan.num_stated;
  report.duration_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  report.peak_memory_bytes = PeakMemoryBytes();
  WriteIfChanged(work.plan_report(), report.ToJson());
}

std::string DescribePlan(const fs::path& work) {
  const BuildPlan plan = ReadPlan(WorkFolder(work));
  return Format("plan %s: %lld panoramas (%zu set aside), %zu shards, %zu tiles, vocabulary %s\n",
                WorkFolder(work).plan().c_str(), static_cast<long long>(plan.num_panoramas()),
                plan.set_aside.size(), plan.shards.size(), plan.tiles.size(),
                plan.vocabulary_sha256.empty()
                    ? "to be trained"
                    : ("release " + plan.vocabulary_sha256.substr(0, 12)).c_str());
}

RunReport Build(BuildOptions options) {
  const ThreadLimit threads(options.num_threads);
  PlanBuild(options);
  const BuildContext context(WorkOf(options));
  for (const Stage stage : kAllStages) {
    if (stage == Stage::kSample && !context.plan.vocabulary_sha256.empty()) continue;
    RunAllUnits(context, stage);
  }
  StopIfCancelled();
  return Publish(context, options.out);
}

}  // namespace panofix
