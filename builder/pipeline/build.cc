#include "builder/pipeline/build.h"

#include <sys/resource.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <mutex>
#include <numeric>
#include <set>
#include <stdexcept>

#include "builder/pipeline/extract_stage.h"
#include "builder/publish/bundle_writer.h"
#include "builder/tiling/quadkey.h"
#include "builder/train/tree_trainer.h"
#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/base/rng.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr char kGenerator[] = "panofix-builder " PANOFIX_VERSION;
// Descriptors a word that k-means is trained on; more changes little and costs linearly.
constexpr std::size_t kSamplesPerWord = 40;

// Times a stage into the report.
class StageTimer {
 public:
  StageTimer(RunReport* report, std::string name, std::string unit)
      : report_(report), start_(std::chrono::steady_clock::now()) {
    stage_.name = std::move(name);
    stage_.unit = std::move(unit);
  }
  void Done(std::size_t num_items, std::size_t num_reused = 0) {
    stage_.duration_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    stage_.num_items = static_cast<std::int64_t>(num_items);
    stage_.num_reused = static_cast<std::int64_t>(num_reused);
    report_->stages.push_back(stage_);
  }

 private:
  RunReport* report_;
  StageReport stage_;
  std::chrono::steady_clock::time_point start_;
};

void StopIfCancelled() {
  if (CancelRequested()) {
    throw Error(ErrorCode::kCancelled, "stopped by the user; run the same command again to resume");
  }
}

Geodetic Centroid(const std::vector<PanoramaRecord>& panoramas) {
  // Longitudes are averaged around the first one, so that a set across the date line stays
  // together.
  Geodetic mean;
  double lon_offset_deg = 0;
  const double lon0_deg = panoramas.front().position.lon_deg;
  for (const PanoramaRecord& p : panoramas) {
    mean.lat_deg += p.position.lat_deg;
    mean.height_m += p.position.height_m;
    lon_offset_deg += AngleDifferenceDeg(p.position.lon_deg, lon0_deg);
  }
  const auto n = static_cast<double>(panoramas.size());
  mean.lat_deg /= n;
  mean.height_m /= n;
  mean.lon_deg = AngleDifferenceDeg(lon0_deg + lon_offset_deg / n, 0);
  return mean;
}

MapFrame ChooseFrame(const BuildOptions& options, const std::vector<PanoramaRecord>& panoramas) {
  if (options.map_frame == "tangent") return MapFrame::Tangent(Centroid(panoramas));
  return ValueOrThrow(MapFrame::FromName(options.map_frame));
}

// Panoramas of the map in bundle order, with poses in map and links by index.
std::vector<MapPanorama> PlacePanoramas(const std::vector<PanoramaRecord>& records,
                                        const MapFrame& frame) {
  std::map<std::string, std::uint32_t> index_of;
  for (std::uint32_t i = 0; i < records.size(); ++i) index_of[records[i].id] = i;
  std::vector<MapPanorama> placed;
  for (const PanoramaRecord& record : records) {
    MapPanorama p;
    p.id = record.id;
    p.position = record.position;
    p.map_from_pano = Rigid3(frame.MapFromEnu(record.position) * EnuFromBody(record.attitude),
                             frame.ToMap(record.position));
    p.point_scale = frame.PointScale(record.position);
    placed.push_back(std::move(p));
  }
  // A link holds both ways, whichever end states it; unknown ids (set aside, or beyond the data
  // set) fall.
  std::vector<std::set<std::uint32_t>> links(records.size());
  for (std::uint32_t i = 0; i < records.size(); ++i) {
    for (const std::string& id : records[i].links) {
      const auto found = index_of.find(id);
      if (found == index_of.end() || found->second == i) continue;
      links[i].insert(found->second);
      links[found->second].insert(i);
    }
  }
  for (std::size_t i = 0; i < links.size(); ++i)
    placed[i].links.assign(links[i].begin(), links[i].end());
  return placed;
}

// Gathers a seeded sample of at most `budget` descriptors, the same share of every panorama.
struct TrainingSample {
  std::vector<std::uint8_t> sift, mser;
};
TrainingSample Sample(const std::vector<ExtractedPanorama>& panoramas,
                      const BuildOptions& options) {
  const std::size_t n = panoramas.size();
  const auto budget = [&](int words) {
    return std::max<std::size_t>(1, static_cast<std::size_t>(words) * kSamplesPerWord / n);
  };
  std::vector<TrainingSample> parts(n);
  tbb::parallel_for(std::size_t{0}, n, [&](std::size_t p) {
    const PanoramaFeatures features =
        ValueOrThrow(ReadPanoramaFeatures(panoramas[p].features_file));
    Rng rng(options.seed, "sample/" + panoramas[p].record.id);
    const auto draw = [&](bool mser, std::size_t count, std::vector<std::uint8_t>* out) {
      std::vector<std::pair<const FeatureSet*, std::size_t>> all;
      for (const ViewFeatureSet& view : features.views) {
        const FeatureSet& set = mser ? view.mser : view.sift;
        for (std::size_t i = 0; i < set.size(); ++i) all.emplace_back(&set, i);
      }
      for (std::size_t i = 0; i < std::min(count, all.size()); ++i) {
        std::swap(all[i], all[i + rng.Below(all.size() - i)]);
        const auto descriptor = all[i].first->descriptor(all[i].second);
        out->insert(out->end(), descriptor.begin(), descriptor.end());
      }
    };
    draw(false, budget(options.num_sift_words), &parts[p].sift);
    draw(true, budget(options.num_mser_words), &parts[p].mser);
  });
  TrainingSample sample;
  for (const TrainingSample& part : parts) {
    sample.sift.insert(sample.sift.end(), part.sift.begin(), part.sift.end());
    sample.mser.insert(sample.mser.end(), part.mser.begin(), part.mser.end());
  }
  return sample;
}

Vocabulary Train(const std::vector<ExtractedPanorama>& panoramas, const BuildOptions& options) {
  const TrainingSample sample = Sample(panoramas, options);
  TreeOptions tree;
  tree.seed = options.seed;
  Vocabulary vocabulary;
  tree.num_words = options.num_sift_words;
  vocabulary.sift = TrainTree(sample.sift, tree, "train/sift");
  tree.num_words = options.num_mser_words;
  vocabulary.mser = TrainTree(sample.mser, tree, "train/mser");
  if (vocabulary.sift.empty()) {
    throw Error(
        ErrorCode::kBadData,
        "no feature in any panorama; check the images, their masks and --sift-contrast-threshold");
  }
  return vocabulary;
}

// Quantises every view, sets the vocabulary's idf and returns a bag a view.
std::vector<BagOfWords> MakeBags(const std::vector<ExtractedPanorama>& panoramas,
                                 std::size_t views_each, Vocabulary* vocabulary) {
  std::vector<std::vector<std::uint32_t>> sift(panoramas.size() * views_each), mser(sift.size());
  Progress progress("words", static_cast<std::int64_t>(panoramas.size()), "panoramas");
  tbb::parallel_for(std::size_t{0}, panoramas.size(), [&](std::size_t p) {
    const PanoramaFeatures features =
        ValueOrThrow(ReadPanoramaFeatures(panoramas[p].features_file));
    for (std::size_t v = 0; v < views_each; ++v) {
      sift[p * views_each + v] = vocabulary->SiftWords(features.views[v].sift);
      mser[p * views_each + v] = vocabulary->MserWords(features.views[v].mser);
    }
    progress.Add();
  });
  progress.Finish();
  std::vector<std::vector<std::uint32_t>> all = sift;
  for (std::size_t i = 0; i < all.size(); ++i)
    all[i].insert(all[i].end(), mser[i].begin(), mser[i].end());
  vocabulary->idf = InverseDocumentFrequency(all, vocabulary->num_words());
  std::vector<BagOfWords> bags(sift.size());
  tbb::parallel_for(std::size_t{0}, bags.size(),
                    [&](std::size_t i) { bags[i] = vocabulary->Bag(sift[i], mser[i]); });
  return bags;
}

// The strongest features with a point, as they go on the map.
BundleView ToBundleView(const ViewFeatureSet& view, int max_features) {
  BundleView out;
  for (std::size_t i = 0; i < view.sift.size(); ++i) {
    if (view.points[i].range_sigma_m <= 0) continue;
    if (out.keypoints.size() / 4 == static_cast<std::size_t>(max_features)) break;
    const Keypoint& k = view.sift.keypoints[i];
    const SurfacePoint& p = view.points[i];
    out.keypoints.insert(out.keypoints.end(), {k.x_px, k.y_px, k.size_px, k.angle_deg});
    out.points.insert(out.points.end(), {p.point_in_pano.x(), p.point_in_pano.y(),
                                         p.point_in_pano.z(), p.range_sigma_m});
    out.surfaces.push_back(p.surface_idx);
    const auto descriptor = view.sift.descriptor(i);
    out.descriptors.insert(out.descriptors.end(), descriptor.begin(), descriptor.end());
  }
  return out;
}

// All contents that a build's result depends on, as one hash: in bundle order, each panorama's
// extraction key, pose and links.
std::string DataSetHash(const std::vector<ExtractedPanorama>& panoramas) {
  Sha256 hash;
  for (const ExtractedPanorama& p : panoramas) {
    const PanoramaRecord& r = p.record;
    hash.Update(p.content_key + Format("\n%.17g %.17g %.17g %.17g %.17g %.17g\n",
                                       r.position.lat_deg, r.position.lon_deg, r.position.height_m,
                                       r.attitude.heading_deg, r.attitude.pitch_deg,
                                       r.attitude.roll_deg));
    for (const std::string& link : r.links) hash.Update(link + "\n");
  }
  return hash.FinishHex();
}

std::uint64_t PeakMemoryBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

}  // namespace

void BuildOptions::Check() const {
  const auto require = [](bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument(message);
  };
  require(num_views >= 1 && num_views <= 64,
          Format("num_views = %d; must lie in 1..64", num_views));
  require(view_pitch_deg > -80 && view_pitch_deg < 80,
          Format("view_pitch_deg = %g; must lie in (-80, 80)", view_pitch_deg));
  require(num_sift_words >= 2, Format("num_sift_words = %d; must be at least 2", num_sift_words));
  require(num_mser_words >= 2, Format("num_mser_words = %d; must be at least 2", num_mser_words));
  require(max_features >= 1, Format("max_features = %d; must be at least 1", max_features));
  require(build >= 0, "build must not be negative");
  require(max_set_aside_share >= 0 && max_set_aside_share <= 1,
          Format("max_set_aside_share = %g; must lie in [0, 1]", max_set_aside_share));
  require(num_threads >= 0, Format("num_threads = %d; must not be negative", num_threads));
  extract.Check();
  similarity.Check();
}

RunReport Build(const BuildOptions& options) {
  options.Check();
  const int threads = options.num_threads > 0
                          ? options.num_threads
                          : static_cast<int>(std::thread::hardware_concurrency());
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  ThrowIfError(CheckParentIsWritable(options.out, "--out"));
  RunReport report;
  const Camera camera = ValueOrThrow(ReadCameraYaml(options.camera));
  StageTimer ingest_timer(&report, "ingest", "panoramas");
  PanoramaSet set = ValueOrThrow(ReadPanoramaSet(options.panoramas));
  const std::size_t num_stated = set.panoramas.size() + set.set_aside.size();
  ingest_timer.Done(num_stated);
  report.set_aside = set.set_aside;

  StageTimer extract_timer(&report, "extract", "panoramas");
  const Rectifier rectifier(camera.WithoutDistortion(),
                            RingOfViews(options.num_views, options.view_pitch_deg));
  const fs::path work =
      options.work.empty() ? fs::path(options.out.string() + ".work") : options.work;
  ExtractStageResult extracted = ExtractStage(set.panoramas, rectifier, options.extract, work);
  extract_timer.Done(set.panoramas.size(), extracted.num_reused);
  report.set_aside.insert(report.set_aside.end(), extracted.set_aside.begin(),
                          extracted.set_aside.end());
  report.without_depth = extracted.without_depth;
  if (extracted.panoramas.empty() ||
      static_cast<double>(report.set_aside.size()) >
          options.max_set_aside_share * static_cast<double>(num_stated)) {
    const SetAside& first = report.set_aside.front();
    throw Error(
        ErrorCode::kBadData,
        Format("%s: %zu of %zu panoramas are unusable (first: %s: %s); mend the data set or raise "
               "--max-set-aside-share",
               options.panoramas.c_str(), report.set_aside.size(), num_stated, first.id.c_str(),
               first.reason.c_str()));
  }
  // Bundle order: by tile, then id, so that a tile's panoramas are together.
  std::vector<ExtractedPanorama>& panoramas = extracted.panoramas;
  const auto key = [](const ExtractedPanorama& p) {
    return std::make_pair(Quadkey(p.record.position), p.record.id);
  };
  std::sort(
      panoramas.begin(), panoramas.end(),
      [&](const ExtractedPanorama& a, const ExtractedPanorama& b) { return key(a) < key(b); });
  StopIfCancelled();

  BundleContent content;
  std::vector<PanoramaRecord> records;
  for (const ExtractedPanorama& p : panoramas) {
    records.push_back(p.record);
    content.tile_of_panorama.push_back(Quadkey(p.record.position));
  }
  const MapFrame frame = ChooseFrame(options, records);
  content.panoramas = PlacePanoramas(records, frame);
  for (std::size_t i = 0; i < panoramas.size(); ++i)
    content.panoramas[i].has_depth = panoramas[i].has_depth;
  content.directions = rectifier.directions();

  StageTimer train_timer(&report, "train", "words");
  content.vocabulary = Train(panoramas, options);
  const std::vector<BagOfWords> bags =
      MakeBags(panoramas, content.directions.size(), &content.vocabulary);
  train_timer.Done(content.vocabulary.num_words());
  StopIfCancelled();

  StageTimer similarity_timer(&report, "similarity", "views");
  std::vector<std::vector<std::uint32_t>> links;
  std::vector<std::array<double, 3>> positions;
  std::vector<std::uint32_t> panorama_of_view;
  for (std::uint32_t p = 0; p < content.panoramas.size(); ++p) {
    links.push_back(content.panoramas[p].links);
    const Eigen::Vector3d& t = content.panoramas[p].map_from_pano.translation;
    positions.push_back({t.x(), t.y(), t.z()});
    panorama_of_view.insert(panorama_of_view.end(), content.directions.size(), p);
  }
  content.similarity = BuildSimilarityIndex(
      bags, panorama_of_view,
      AppearanceNeighbourhoods(links, positions, options.num_views, options.similarity),
      options.similarity);
  similarity_timer.Done(bags.size());

  StageTimer publish_timer(&report, "publish", "files");
  Manifest& manifest = content.manifest;
  manifest.name = options.name.empty()
                      ? fs::absolute(options.out).lexically_normal().filename().string()
                      : options.name;
  manifest.build = options.build;
  manifest.generator = kGenerator;
  manifest.map_frame = frame.parameters();
  manifest.camera = camera;
  manifest.features = options.extract.features;
  manifest.errors = options.extract.errors;
  manifest.provenance = {set.source, set.licence, set.height_datum, DataSetHash(panoramas),
                         OptionsJson(options)};
  manifest.num_set_aside = static_cast<std::int64_t>(report.set_aside.size());
  const Manifest written = WriteBundle(options.out, content, [&](std::size_t p) {
    const PanoramaFeatures features =
        ValueOrThrow(ReadPanoramaFeatures(panoramas[p].features_file));
    BundlePanorama panorama;
    for (const DepthPlane& plane : features.planes) {
      const Eigen::Vector3f& n = plane.normal_in_pano;
      panorama.planes.insert(panorama.planes.end(), {n.x(), n.y(), n.z(), plane.d_m});
    }
    for (std::size_t v = 0; v < features.views.size(); ++v) {
      panorama.views.push_back(ToBundleView(features.views[v], options.max_features));
      panorama.views.back().bag = bags[p * content.directions.size() + v];
    }
    return panorama;
  });
  publish_timer.Done(written.parts.size() + 1);

  report.num_panoramas = written.num_panoramas;
  report.num_views = written.num_views;
  report.num_features = written.num_features;
  const std::string text = ToJson(written);
  report.bundle_id = Sha256Hex(text);
  report.bundle_bytes = text.size();
  for (const BundlePart& part : written.parts) report.bundle_bytes += part.num_bytes;
  report.peak_memory_bytes = PeakMemoryBytes();
  ThrowIfError(WriteFileAtomically(options.out.string() + ".report.json", report.ToJson()));
  return report;
}

}  // namespace panofix
