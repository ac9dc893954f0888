// Publishing what was assembled, with the report of the whole run.
#include <fstream>
#include <sstream>

#include "builder/pipeline/stages.h"
#include "builder/publish/bundle_writer.h"
#include "common/base/memory.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

std::string ReadText(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file) text << file.rdbuf();
  return text.str();
}

std::vector<std::string> UnitsOf(const BuildPlan& plan, Stage stage) {
  std::vector<std::string> units;
  switch (UnitOf(stage)) {
    case StageUnit::kShard:
      for (const auto& [shard, unused] : plan.shards) units.push_back(shard);
      break;
    case StageUnit::kTile:
      for (const auto& [tile, unused] : plan.tiles) units.push_back(tile);
      break;
    case StageUnit::kAll:
      units = {kAllUnit};
      break;
  }
  return units;
}

// What a unit that did not run tonight would have counted.
std::int64_t ItemsOf(const BuildPlan& plan, Stage stage, const std::string& unit) {
  const auto shard = plan.shards.find(unit);
  const bool is_panoramas = stage != Stage::kSample && UnitOf(stage) == StageUnit::kShard;
  return is_panoramas && shard != plan.shards.end() ? shard->second.num_panoramas : 1;
}

StageReport SumUp(const BuildContext& context, Stage stage, const std::string& run,
                  RunReport* report) {
  StageReport sum;
  sum.name = StageName(stage);
  sum.num_units = sum.num_units_run = 0;
  switch (UnitOf(stage)) {
    case StageUnit::kShard:
      sum.unit = stage == Stage::kSample ? "shards" : "panoramas";
      break;
    case StageUnit::kTile:
      sum.unit = "tiles";
      break;
    case StageUnit::kAll:
      sum.unit = "files";
      break;
  }
  Sha256 hash;
  for (const std::string& unit : UnitsOf(context.plan, stage)) {
    ++sum.num_units;
    hash.Update(unit + " " + ReceiptSha256(context.work, stage, unit) + "\n");
    const auto of_unit = FindReport(context.work, stage, unit);
    if (of_unit && of_unit->saturation) report->saturation = of_unit->saturation;
    if (of_unit && of_unit->run == run) {
      sum.Add(*of_unit);
    } else {
      const std::int64_t num_items = ItemsOf(context.plan, stage, unit);
      sum.num_items += num_items, sum.num_reused += num_items;
    }
  }
  sum.result_sha256 = hash.FinishHex();
  return sum;
}

void AddPanoramas(const BuildContext& context, RunReport* report) {
  report->set_aside = context.plan.set_aside;
  for (const auto& [shard, unused] : context.plan.shards) {
    const auto receipt = ReadReceipt<ExtractReceipt>(context.work, Stage::kExtract, shard, nullptr);
    report->set_aside.insert(report->set_aside.end(), receipt.set_aside.begin(),
                             receipt.set_aside.end());
    report->without_depth.insert(report->without_depth.end(), receipt.without_depth.begin(),
                                 receipt.without_depth.end());
  }
  for (const auto& [tile, unused] : context.plan.tiles) {
    const auto receipt = ReadReceipt<TileReceipt>(context.work, Stage::kLandmarks, tile, nullptr);
    for (const RefinedPose& refined : receipt.refined) report->refined.push_back(refined.report);
  }
}

void RequireCurrent(const BuildContext& context, const AssembleReceipt& assembled) {
  MadeFrom now = context.MadeFromPlan({});
  for (const auto& [shard, plan] : context.plan.shards)
    now["records/" + shard] = plan.records_sha256;
  for (const Stage stage : kAllStages) {
    if (stage == Stage::kAssemble) continue;
    if (stage == Stage::kSample && !context.plan.vocabulary_sha256.empty()) continue;
    for (const std::string& unit : UnitsOf(context.plan, stage)) {
      now[std::string(StageName(stage)) + "/" + unit] = ReceiptSha256(context.work, stage, unit);
    }
  }
  const Manifest manifest = ValueOrThrow(ParseManifest(assembled.manifest, "assembled manifest"));
  if (assembled.made_from == now && manifest.name == context.plan.options.name &&
      manifest.build == context.plan.options.build) {
    return;
  }
  throw Error(ErrorCode::kTryAgain,
              "what is assembled is not of this plan; run: panofix-builder assemble");
}

}  // namespace

RunReport Publish(const BuildContext& context, const fs::path& out) {
  const auto start = std::chrono::steady_clock::now();
  const auto assembled =
      ReadReceipt<AssembleReceipt>(context.work, Stage::kAssemble, kAllUnit, nullptr);
  RequireCurrent(context, assembled);
  const Manifest manifest = ValueOrThrow(ParseManifest(assembled.manifest, "assembled manifest"));
  RunReport report;
  const std::string run = ReadRun(context.work);
  if (const auto plan = UnitReport::Parse(ReadText(context.work.plan_report()))) {
    StageReport stage;
    stage.name = "plan";
    stage.unit = "panoramas", stage.num_units_run = 0;
    stage.Add(*plan);
    report.stages.push_back(stage);
  }
  for (const Stage stage : kAllStages) {
    if (stage == Stage::kSample && !context.plan.vocabulary_sha256.empty()) continue;
    report.stages.push_back(SumUp(context, stage, run, &report));
  }
  AddPanoramas(context, &report);
  std::vector<FinishedPart> parts;
  for (const AssembleReceipt::Part& part : assembled.parts) {
    report.bundle_bytes += part.content.num_bytes;
    if (part.path == "vocabulary.h5") report.vocabulary_release = part.content.sha256.substr(0, 12);
    parts.push_back({{part.path, part.content.num_bytes, part.content.sha256},
                     context.work.root() / part.file});
  }
  const std::string text = ToJson(PublishParts(out, manifest, parts));
  report.num_panoramas = manifest.num_panoramas;
  report.num_stations = manifest.num_stations;
  report.num_views = manifest.num_views;
  report.num_landmarks = manifest.num_landmarks;
  report.bundle_id = Sha256Hex(text);
  report.bundle_bytes += text.size();
  StageReport publish;
  publish.name = "publish";
  publish.duration_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  publish.num_items = static_cast<std::int64_t>(parts.size());
  publish.unit = "files";
  publish.num_bytes_written = report.bundle_bytes;
  publish.peak_memory_bytes = PeakMemoryBytes();
  publish.result_sha256 = report.bundle_id;
  report.stages.push_back(publish);
  for (const StageReport& stage : report.stages)
    report.peak_memory_bytes = std::max(report.peak_memory_bytes, stage.peak_memory_bytes);
  ThrowIfError(WriteFileAtomically(out.string() + ".report.json", report.ToJson()));
  return report;
}

}  // namespace panofix
