#include "builder/pipeline/extract_stage.h"

#include <tbb/parallel_for.h>

#include "builder/pipeline/attempt.h"
#include "common/base/cancel.h"
#include "common/base/log.h"
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
  std::uint64_t num_bytes = 0;
  bool reused = false;
};

std::string HashOf(const fs::path& path) {
  if (path.empty()) return "-";
  // A file that cannot be read has no hash; extraction says why.
  const auto digest = Sha256OfFile(path);
  return digest.ok() ? *digest : "?";
}

Outcome ProcessOne(const PanoramaRecord& record, const Rectifier& rectifier,
                   const ExtractOptions& options, const WorkFolder& work) {
  Outcome outcome;
  const KeyParts key = ContentKey(record, rectifier, options);
  outcome.panorama.record = record;
  outcome.panorama.content_key = key.Hex();
  outcome.panorama.parts = key.digests();
  outcome.panorama.features_file = work.Content("features", outcome.panorama.content_key);
  Result<PanoramaFeatures> features = Status(ErrorCode::kNotFound, "not extracted yet");
  if (fs::exists(outcome.panorama.features_file)) {
    features = ReadPanoramaFeatures(outcome.panorama.features_file);
    outcome.reused = features.ok();
  }
  if (!features.ok()) {
    const Attempt attempt(work, Stage::kExtract, record.id, outcome.panorama.content_key);
    if (attempt.IsHopeless()) {
      outcome.failure = Status(ErrorCode::kBadData, attempt.Reason());
      return outcome;
    }
    features = ExtractPanorama(record, rectifier, options);
    if (!features.ok()) {
      outcome.failure = features.status();
      return outcome;
    }
    WritePanoramaFeatures(outcome.panorama.features_file, *features);
    outcome.num_bytes = fs::file_size(outcome.panorama.features_file);
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

KeyParts ContentKey(const PanoramaRecord& record, const Rectifier& rectifier,
                    const ExtractOptions& options) {
  KeyParts key;
  key.Add("program", Format("extract %d", kExtractVersion));
  std::string views = ToCameraYaml(rectifier.camera(), "view");
  for (const ViewDirection& d : rectifier.directions())
    views += Format("%.17g %.17g\n", d.yaw_deg, d.pitch_deg);
  key.Add("camera and views", views);
  const FeatureOptions& f = options.features;
  key.Add("options", Format("%d %.17g %d %d %.17g %d %d\n", static_cast<int>(f.equalization),
                            f.clahe_clip_limit, f.clahe_tiles, f.max_sift,
                            f.sift_contrast_threshold, f.max_mser, f.root_sift ? 1 : 0) +
                         Format("%.17g %.17g %.17g %.17g %.17g\n", options.errors.range_sigma_share,
                                options.errors.normal_sigma_deg, options.errors.relief_sigma_m,
                                options.max_range_m, options.max_incidence_deg));
  key.Add("id", record.id);
  key.Add("image", HashOf(record.image));
  key.Add("depth", HashOf(record.depth) + Format(" %.17g", record.depth_scale_m));
  key.Add("mask", HashOf(record.mask));
  return key;
}

ExtractStageResult ExtractStage(const std::vector<PanoramaRecord>& records,
                                const Rectifier& rectifier, const ExtractOptions& options,
                                const WorkFolder& work, Progress* progress) {
  std::vector<Outcome> outcomes(records.size());
  const auto process = [&](std::size_t i) {
    if (CancelRequested()) return;
    outcomes[i] = ProcessOne(records[i], rectifier, options, work);
    if (progress != nullptr) progress->Add();
  };
  std::vector<std::size_t> others;
  for (std::size_t i = 0; i < records.size(); ++i) {
    if (Attempt::IsSuspect(work, Stage::kExtract, records[i].id)) {
      process(i);
    } else {
      others.push_back(i);
    }
  }
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, others.size(), 1),
      [&](const auto& range) {
        for (std::size_t k = range.begin(); k < range.end(); ++k) process(others[k]);
      },
      tbb::simple_partitioner());
  StopIfCancelled();
  ExtractStageResult result;
  for (Outcome& outcome : outcomes) {
    if (!outcome.failure.ok()) {
      result.set_aside.push_back({outcome.panorama.record.id, outcome.failure.message()});
      continue;
    }
    if (!outcome.reused) result.made.push_back(static_cast<std::uint32_t>(result.panoramas.size()));
    result.num_bytes_written += outcome.num_bytes;
    if (!outcome.depth_fault.empty()) {
      result.without_depth.push_back({outcome.panorama.record.id, outcome.depth_fault});
    }
    result.panoramas.push_back(std::move(outcome.panorama));
  }
  return result;
}

}  // namespace panofix
