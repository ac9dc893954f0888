// Stages over a shard: extract, augment, words.
#include <tbb/parallel_for.h>

#include <unordered_map>

#include "builder/pipeline/augment_stage.h"
#include "builder/pipeline/stages.h"
#include "builder/pipeline/vocabulary_stage.h"
#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/hdf5_file.h"
#include "common/io/sha256.h"
#include "common/map/vocabulary_file.h"

namespace panofix::stages {
namespace {

namespace fs = std::filesystem;

// Raised whenever equal features give other words for equal trees.
constexpr int kWordsVersion = 1;

// What decided each panorama's file the last time.
using Before = std::unordered_map<std::string, PartDigests>;

const PartDigests* Find(const Before& before, const std::string& id) {
  const auto found = before.find(id);
  return found == before.end() ? nullptr : &found->second;
}

template <typename Receipt>
Before PartsBefore(const BuildContext& context, Stage stage, const std::string& shard) {
  Before before;
  if (const auto old = FindReceipt<Receipt>(context.work, stage, shard)) {
    for (const auto& panorama : old->panoramas) before[panorama.made.id] = panorama.made.parts;
  }
  return before;
}

// Unusable panoramas that the other shards have found in this run.
std::int64_t NumSetAsideElsewhere(const BuildContext& context, const std::string& shard) {
  const std::string run = ReadRun(context.work);
  std::int64_t num = 0;
  for (const auto& [other, unused] : context.plan.shards) {
    if (other == shard) continue;
    const auto report = FindReport(context.work, Stage::kExtract, other);
    if (report && report->run == run) num += report->num_set_aside;
  }
  return num;
}

bool IsUsable(const fs::path& words_file) {
  return fs::exists(words_file) && ReadWords(words_file).ok();
}

}  // namespace

UnitReport Extract(const BuildContext& context, const std::string& shard, Progress* progress) {
  const std::vector<PanoramaRecord> records = ReadRecords(context.work, context.plan, shard);
  ExtractStageResult result = ExtractStage(records, context.rectifier, context.plan.options.extract,
                                           context.work, progress);
  // The shards so far may show that the whole cannot be built, before hours go into it.
  std::vector<SetAside> all_aside = context.plan.set_aside;
  all_aside.insert(all_aside.end(), result.set_aside.begin(), result.set_aside.end());
  RefuseTooManySetAside(context.plan, all_aside, NumSetAsideElsewhere(context, shard));

  const Before before = PartsBefore<ExtractReceipt>(context, Stage::kExtract, shard);
  UnitReport report;
  report.num_items = static_cast<std::int64_t>(records.size());
  report.num_bytes_written = result.num_bytes_written;
  for (const std::uint32_t i : result.made)
    report.AddRedone(result.panoramas[i].record.id, Find(before, result.panoramas[i].record.id),
                     result.panoramas[i].parts);
  report.num_set_aside = static_cast<std::int64_t>(result.set_aside.size());
  report.num_redone += report.num_set_aside;  // looked at every time
  ExtractReceipt receipt;
  receipt.made_from = context.MadeFromPlan({shard});
  for (const ExtractedPanorama& p : result.panoramas)
    receipt.panoramas.push_back({{p.record.id, p.content_key, p.parts}, p.has_depth});
  receipt.set_aside = std::move(result.set_aside);
  receipt.without_depth = std::move(result.without_depth);
  WriteReceipt(context.work, Stage::kExtract, shard, receipt);
  return report;
}

UnitReport Augment(const BuildContext& context, const std::string& shard, Progress* progress) {
  const Region region = ReadRegion(context, WithHalo(context.plan, shard));
  const std::vector<std::uint32_t> own = region.OfShard(shard);
  StationExtractOptions options;
  options.extract = context.plan.options.extract;
  options.render = context.plan.options.render;
  const AugmentStageResult result =
      AugmentStage(region.panoramas, own, context.rectifier, context.plan.options.stations, options,
                   context.work, progress);
  const Before before = PartsBefore<AugmentReceipt>(context, Stage::kAugment, shard);
  UnitReport report;
  report.num_items = static_cast<std::int64_t>(own.size());
  report.num_bytes_written = result.num_bytes_written;
  AugmentReceipt receipt;
  receipt.made_from = region.made_from;
  for (std::size_t i = 0; i < own.size(); ++i) {
    AugmentReceipt::Panorama p{
        {region.panoramas[own[i]].record.id, result.keys[i], result.parts[i]}, {}};
    for (const Station& station : result.stations[i]) {
      const Eigen::Vector3d& at = station.position_in_pano;
      p.stations.push_back({at.x(), at.y(), at.z()});
    }
    receipt.panoramas.push_back(std::move(p));
  }
  for (const std::uint32_t i : result.made)
    report.AddRedone(receipt.panoramas[i].made.id, Find(before, receipt.panoramas[i].made.id),
                     result.parts[i]);
  WriteReceipt(context.work, Stage::kAugment, shard, receipt);
  return report;
}

UnitReport Words(const BuildContext& context, const std::string& shard, Progress* progress) {
  WordsReceipt receipt;
  const auto augmented =
      ReadReceipt<AugmentReceipt>(context.work, Stage::kAugment, shard, &receipt.made_from);
  const auto extracted =
      ReadReceipt<ExtractReceipt>(context.work, Stage::kExtract, shard, &receipt.made_from);
  const auto trees =
      ReadReceipt<FileReceipt>(context.work, Stage::kTrain, kAllUnit, &receipt.made_from);
  receipt.made_from.merge(context.MadeFromPlan({shard}));
  const auto file = ValueOrThrow(Hdf5Reader::Open(context.work.Content("vocabularies", trees.key)));
  const Vocabulary vocabulary = ValueOrThrow(ReadVocabulary(file));
  std::unordered_map<std::string, std::string> native_key;
  for (const ExtractReceipt::Panorama& p : extracted.panoramas) native_key[p.made.id] = p.made.key;

  const std::size_t n = augmented.panoramas.size();
  std::vector<std::uint64_t> num_bytes(n, 0);
  receipt.panoramas.resize(n);
  std::vector<std::vector<ViewWords>> words(n);
  tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
    if (CancelRequested()) return;
    const MadeFile& rendered = augmented.panoramas[i].made;
    const std::string& native = native_key.at(rendered.id);
    KeyParts key;
    key.Add("program", Format("words %d", kWordsVersion));
    key.Add("trees", trees.parts.at("trees"));
    key.Add("its own features", native);
    key.Add("its stations' features", rendered.key);
    receipt.panoramas[i] = {rendered.id, key.Hex(), key.digests()};
    const fs::path path = context.work.Content("words", receipt.panoramas[i].key);
    if (!IsUsable(path)) {
      std::vector<PanoramaFeatures> features;
      features.push_back(
          ValueOrThrow(ReadPanoramaFeatures(context.work.Content("features", native))));
      if (!rendered.key.empty()) {
        features.push_back(
            ValueOrThrow(ReadPanoramaFeatures(context.work.Content("stations", rendered.key))));
      }
      WriteWords(path, QuantiseViews(features, vocabulary));
      num_bytes[i] = fs::file_size(path);
    }
    words[i] = ValueOrThrow(ReadWords(path));
    if (progress != nullptr) progress->Add();
  });
  StopIfCancelled();

  std::vector<std::uint32_t> counts(vocabulary.num_words(), 0);
  std::uint32_t num_views = 0;
  for (const auto& views : words) {
    CountWords(views, &counts);
    num_views += static_cast<std::uint32_t>(views.size());
  }
  counts.push_back(num_views);
  const std::string bytes(reinterpret_cast<const char*>(counts.data()), 4 * counts.size());
  receipt.counts_key = Sha256Hex(bytes);
  const fs::path counts_file = context.work.Content("counts", receipt.counts_key);
  Before before;
  if (const auto old = FindReceipt<WordsReceipt>(context.work, Stage::kWords, shard)) {
    for (const MadeFile& p : old->panoramas) before[p.id] = p.parts;
  }
  Hdf5Writer counts_writer(counts_file);
  counts_writer.Write<std::uint32_t>("counts", counts);
  counts_writer.Close();
  UnitReport report;
  report.num_items = static_cast<std::int64_t>(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (num_bytes[i] > 0)
      report.AddRedone(receipt.panoramas[i].id, Find(before, receipt.panoramas[i].id),
                       receipt.panoramas[i].parts);
    report.num_bytes_written += num_bytes[i];
  }
  WriteReceipt(context.work, Stage::kWords, shard, receipt);
  return report;
}

}  // namespace panofix::stages
