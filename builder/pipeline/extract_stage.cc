#include "builder/pipeline/extract_stage.h"

#include <tbb/parallel_for.h>

#include <atomic>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// Raised whenever extraction gives other features for the same input: old work files are then
// ignored.
constexpr int kExtractVersion = 3;

struct Outcome {
  ExtractedPanorama panorama;
  Status failure;
  std::string depth_fault;
  bool reused = false, done = false;
};

void UpdateWithFile(const fs::path& path, Sha256* hash) {
  if (path.empty()) {
    hash->Update("-\n");
    return;
  }
  // A file that cannot be read has no hash; extraction says why.
  const auto digest = Sha256OfFile(path);
  hash->Update(digest.ok() ? *digest + "\n" : "?\n");
}

Outcome ProcessOne(const PanoramaRecord& record, const Rectifier& rectifier,
                   const ExtractOptions& options, const fs::path& folder) {
  Outcome outcome;
  outcome.done = true;
  outcome.panorama.record = record;
  const auto key = ContentKey(record, rectifier, options);
  if (!key.ok()) {
    outcome.failure = key.status();
    return outcome;
  }
  outcome.panorama.content_key = *key;
  outcome.panorama.features_file = folder / (*key + ".h5");
  Result<PanoramaFeatures> features = Status(ErrorCode::kNotFound, "not extracted yet");
  if (fs::exists(outcome.panorama.features_file)) {
    features = ReadPanoramaFeatures(outcome.panorama.features_file);
    outcome.reused = features.ok();
  }
  if (!features.ok()) {
    features = ExtractPanorama(record, rectifier, options);
    if (!features.ok()) {
      outcome.failure = features.status();
      return outcome;
    }
    WritePanoramaFeatures(outcome.panorama.features_file, *features);
  }
  outcome.panorama.has_depth = features->has_depth;
  if (!features->has_depth) {
    outcome.depth_fault =
        features->depth_fault.empty() ? "no depth file is named" : features->depth_fault;
  }
  return outcome;
}

}  // namespace

void StopIfCancelled() {
  if (CancelRequested()) {
    throw Error(ErrorCode::kCancelled, "stopped by the user; run the same command again to resume");
  }
}

Result<std::string> ContentKey(const PanoramaRecord& record, const Rectifier& rectifier,
                               const ExtractOptions& options) {
  Sha256 hash;
  hash.Update(Format("extract %d\n", kExtractVersion));
  hash.Update(ToCameraYaml(rectifier.camera(), "view"));
  for (const ViewDirection& d : rectifier.directions())
    hash.Update(Format("%.17g %.17g\n", d.yaw_deg, d.pitch_deg));
  const FeatureOptions& f = options.features;
  hash.Update(Format("%d %.17g %d %d %.17g %d %d\n", static_cast<int>(f.equalization),
                     f.clahe_clip_limit, f.clahe_tiles, f.max_sift, f.sift_contrast_threshold,
                     f.max_mser, f.root_sift ? 1 : 0));
  hash.Update(Format("%.17g %.17g %.17g %.17g %.17g\n", options.errors.range_sigma_share,
                     options.errors.normal_sigma_deg, options.errors.relief_sigma_m,
                     options.max_range_m, options.max_incidence_deg));
  hash.Update(record.id + Format("\n%.17g\n", record.depth_scale_m));
  UpdateWithFile(record.image, &hash);
  UpdateWithFile(record.depth, &hash);
  UpdateWithFile(record.mask, &hash);
  return hash.FinishHex();
}

ExtractStageResult ExtractStage(const std::vector<PanoramaRecord>& records,
                                const Rectifier& rectifier, const ExtractOptions& options,
                                const fs::path& work) {
  const fs::path folder = work / "features";
  ThrowIfError(MakeDirectories(folder, "--work"));
  std::vector<Outcome> outcomes(records.size());
  Progress progress("extract", static_cast<std::int64_t>(records.size()), "panoramas");
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, records.size(), 1),
      [&](const auto& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          if (CancelRequested()) return;
          outcomes[i] = ProcessOne(records[i], rectifier, options, folder);
          progress.Add();
        }
      },
      tbb::simple_partitioner());
  progress.Finish();
  StopIfCancelled();
  ExtractStageResult result;
  for (Outcome& outcome : outcomes) {
    if (!outcome.failure.ok()) {
      result.set_aside.push_back({outcome.panorama.record.id, outcome.failure.message()});
      continue;
    }
    if (outcome.reused) ++result.num_reused;
    if (!outcome.depth_fault.empty()) {
      result.without_depth.push_back({outcome.panorama.record.id, outcome.depth_fault});
    }
    result.panoramas.push_back(std::move(outcome.panorama));
  }
  return result;
}

}  // namespace panofix
