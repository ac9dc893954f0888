// Stages of the vocabulary: sample, train, weigh.
#include "builder/pipeline/stages.h"
#include "builder/pipeline/vocabulary_stage.h"
#include "builder/publish/bundle_parts.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/hdf5_file.h"
#include "common/io/sha256.h"
#include "common/map/vocabulary_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// Raised whenever equal features give another sample, or an equal sample other trees.
constexpr int kSampleVersion = 1, kTrainVersion = 1;

VocabularyStageOptions OptionsOf(const BuildContext& context) {
  const BuildOptions& o = context.plan.options;
  return {o.num_sift_words, o.num_mser_words, o.seed, o.pack_descriptors};
}

// Trees alone: idf is another matter.
std::string TreesSha256(const Vocabulary& vocabulary) {
  Sha256 hash;
  for (const VocabularyTree* tree : {&vocabulary.sift, &vocabulary.mser}) {
    hash.Update(Format("%zu %zu\n", tree->word.size(), tree->centroids.size()));
    hash.Update(tree->centroids);
    for (const auto* array : {&tree->first_child, &tree->num_children, &tree->word}) {
      hash.Update(std::span(reinterpret_cast<const std::uint8_t*>(array->data()),
                            array->size() * sizeof(std::uint32_t)));
    }
  }
  return hash.FinishHex();
}

Vocabulary ReadFile(const fs::path& path) {
  const auto file = Hdf5Reader::Open(path);
  if (!file.ok()) throw Error(ErrorCode::kTryAgain, file.status().message());
  return ValueOrThrow(ReadVocabulary(*file));
}

bool IsUsable(const fs::path& path) {
  const auto file = Hdf5Reader::Open(path);
  return file.ok() && ReadVocabulary(*file).ok();
}

const PartDigests* PartsOf(const std::optional<FileReceipt>& receipt) {
  return receipt ? &receipt->parts : nullptr;
}

// The release that the plan names, as the file that later stages read.
FileReceipt TakeRelease(const BuildContext& context) {
  FileReceipt receipt;
  receipt.made_from = context.MadeFromPlan({});
  receipt.key = context.plan.vocabulary_sha256;
  const fs::path file = context.work.Content("vocabularies", receipt.key);
  const auto there = Sha256OfFile(file);
  if (!there.ok() || *there != receipt.key) {
    const auto bytes = ValueOrThrow(Sha256OfFile(context.work.release()));
    if (bytes != receipt.key) {
      throw Error(ErrorCode::kTryAgain, context.work.release().string() +
                                            ": not the release of this plan; run the plan again");
    }
    const fs::path aside = file.string() + "." + UniqueWord() + ".tmp";
    fs::copy_file(context.work.release(), aside);
    fs::rename(aside, file);
  }
  receipt.parts["trees"] = TreesSha256(ReadFile(file));
  return receipt;
}

}  // namespace

Vocabulary ReadBuildVocabulary(const BuildContext& context, FileReceipt* receipt,
                               MadeFrom* made_from) {
  *receipt = ReadReceipt<FileReceipt>(context.work, Stage::kWeigh, kAllUnit, made_from);
  return ReadFile(context.work.Content("vocabularies", receipt->key));
}

namespace stages {

UnitReport Sample(const BuildContext& context, const std::string& shard) {
  const Region region = ReadRegion(context, {shard});
  const VocabularyStageOptions options = OptionsOf(context);
  const auto num_in_build = static_cast<std::size_t>(context.plan.num_panoramas());
  KeyParts key;
  key.Add("program", Format("sample %d", kSampleVersion));
  key.Add("size of the build", std::to_string(num_in_build));
  key.Add("options", Format("%d %d %llu", options.num_sift_words, options.num_mser_words,
                            static_cast<unsigned long long>(options.seed)));
  std::vector<std::string> ids;
  for (const ExtractedPanorama& p : region.panoramas) {
    key.AddPanorama(p.record.id, p.content_key);
    ids.push_back(p.record.id);
  }
  FileReceipt receipt{region.made_from, key.Hex(), key.digests()};
  const fs::path file = context.work.Content("samples", receipt.key);
  UnitReport report;
  report.num_items = 1;
  std::map<std::string, TrainingSample> ignored;
  if (!ReadSamples(file, &ignored).ok()) {
    const auto before = FindReceipt<FileReceipt>(context.work, Stage::kSample, shard);
    WriteSamples(file, ids, SampleDescriptors(region.panoramas, num_in_build, options));
    report.AddRedone(shard, PartsOf(before), receipt.parts);
    report.num_bytes_written = fs::file_size(file);
  }
  WriteReceipt(context.work, Stage::kSample, shard, receipt);
  return report;
}

UnitReport Train(const BuildContext& context) {
  UnitReport report;
  report.num_items = 1;
  if (!context.plan.vocabulary_sha256.empty()) {
    WriteReceipt(context.work, Stage::kTrain, kAllUnit, TakeRelease(context));
    return report;
  }
  const VocabularyStageOptions options = OptionsOf(context);
  FileReceipt receipt;
  receipt.made_from = context.MadeFromPlan({});
  KeyParts key;
  key.Add("program", Format("train %d", kTrainVersion));
  key.Add("options", Format("%d %d %llu %d", options.num_sift_words, options.num_mser_words,
                            static_cast<unsigned long long>(options.seed), options.pack ? 1 : 0));
  std::map<std::string, TrainingSample> samples;
  std::vector<fs::path> files;
  for (const auto& [shard, unused] : context.plan.shards) {
    const auto sample =
        ReadReceipt<FileReceipt>(context.work, Stage::kSample, shard, &receipt.made_from);
    files.push_back(context.work.Content("samples", sample.key));
    ThrowIfError(ReadSamples(files.back(), &samples));
  }
  TrainingSample all;
  for (const auto& [id, sample] : samples) {
    all.sift.insert(all.sift.end(), sample.sift.begin(), sample.sift.end());
    all.mser.insert(all.mser.end(), sample.mser.begin(), sample.mser.end());
  }
  // By what it is, not by where it came from: shards of another size give the same sample.
  Sha256 hash;
  hash.Update(all.sift);
  hash.Update("|");
  hash.Update(all.mser);
  key.Add("sample", hash.FinishHex());
  receipt.key = key.Hex();
  const fs::path file = context.work.Content("vocabularies", receipt.key);
  receipt.parts = key.digests();
  if (!IsUsable(file)) {
    const auto before = FindReceipt<FileReceipt>(context.work, Stage::kTrain, kAllUnit);
    WriteVocabulary(file, TrainVocabulary(all, options), options.pack);
    report.AddRedone("trees", PartsOf(before), key.digests());
    report.num_bytes_written = fs::file_size(file);
  }
  receipt.parts["trees"] = TreesSha256(ReadFile(file));
  WriteReceipt(context.work, Stage::kTrain, kAllUnit, receipt);
  return report;
}

UnitReport Weigh(const BuildContext& context) {
  UnitReport report;
  report.num_items = 1;
  FileReceipt receipt;
  receipt.made_from = context.MadeFromPlan({});
  const auto trees =
      ReadReceipt<FileReceipt>(context.work, Stage::kTrain, kAllUnit, &receipt.made_from);
  Vocabulary vocabulary = ReadFile(context.work.Content("vocabularies", trees.key));
  std::vector<std::uint32_t> counts(vocabulary.num_words() + std::size_t{1}, 0);
  for (const auto& [shard, unused] : context.plan.shards) {
    const auto words =
        ReadReceipt<WordsReceipt>(context.work, Stage::kWords, shard, &receipt.made_from);
    const auto file =
        ValueOrThrow(Hdf5Reader::Open(context.work.Content("counts", words.counts_key)));
    const auto some = ValueOrThrow(file.Read<std::uint32_t>("counts"));
    if (some.values.size() != counts.size()) {
      throw Error(ErrorCode::kTryAgain, "words of shard " + shard +
                                            " are of other trees; run: panofix-builder " +
                                            StageCommand(Stage::kWords, shard));
    }
    for (std::size_t i = 0; i < counts.size(); ++i) counts[i] += some.values[i];
  }
  const std::uint32_t num_views = counts.back();
  counts.pop_back();
  const std::vector<float> idf = InverseDocumentFrequency(counts, num_views);
  report.saturation = SaturationOf(idf);
  if (!context.plan.vocabulary_sha256.empty()) {
    receipt.key = trees.key;
    receipt.parts = {{"release", trees.key}};
  } else {
    const std::string bytes(reinterpret_cast<const char*>(counts.data()), 4 * counts.size());
    KeyParts key;
    key.Add("trees", trees.key);
    key.Add("words of all views", bytes + std::to_string(num_views));
    receipt.key = key.Hex();
    receipt.parts = key.digests();
    const fs::path file = context.work.Content("vocabularies", receipt.key);
    if (!IsUsable(file)) {
      const auto before = FindReceipt<FileReceipt>(context.work, Stage::kWeigh, kAllUnit);
      vocabulary.idf = idf;
      WriteVocabulary(file, vocabulary, context.plan.options.pack_descriptors);
      report.AddRedone("weights", PartsOf(before), receipt.parts);
      report.num_bytes_written = fs::file_size(file);
    }
  }
  receipt.parts["file"] =
      ValueOrThrow(Sha256OfFile(context.work.Content("vocabularies", receipt.key)));
  WriteReceipt(context.work, Stage::kWeigh, kAllUnit, receipt);
  return report;
}

}  // namespace stages
}  // namespace panofix
