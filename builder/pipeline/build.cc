// The whole build: the stages in order, each timed into the report.
#include "builder/pipeline/build.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <stdexcept>
#include <thread>

#include "builder/pipeline/augment_stage.h"
#include "builder/pipeline/extract_stage.h"
#include "builder/pipeline/landmark_stage.h"
#include "builder/pipeline/placement.h"
#include "builder/pipeline/view_images.h"
#include "builder/pipeline/vocabulary_stage.h"
#include "builder/publish/bundle_writer.h"
#include "builder/tiling/quadkey.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/base/progress.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr char kGenerator[] = "panofix-builder " PANOFIX_VERSION;

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

// What is at --out is replaced: it must be a bundle, or nothing that anybody could miss.
void RefuseForeignFolder(const fs::path& out) {
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

// One build under way: what a stage leaves for the next.
class BuildRun {
 public:
  explicit BuildRun(const BuildOptions& options)
      : options_(options),
        work_(options.work.empty() ? fs::path(options.out.string() + ".work") : options.work),
        camera_(ValueOrThrow(ReadCameraYaml(options.camera))),
        rectifier_(camera_.WithoutDistortion(),
                   RingOfViews(options.num_views, options.view_pitch_deg)) {}

  RunReport Run() {
    Ingest();
    Extract();
    Place();
    Augment();
    StopIfCancelled();
    Train();
    StopIfCancelled();
    IndexSimilarity();
    Publish();
    return report_;
  }

 private:
  void Ingest() {
    StageTimer timer(&report_, "ingest", "panoramas");
    set_ = ValueOrThrow(ReadPanoramaSet(options_.panoramas));
    report_.set_aside = set_.set_aside;
    timer.Done(set_.panoramas.size() + set_.set_aside.size());
  }

  void Extract() {
    StageTimer timer(&report_, "extract", "panoramas");
    ExtractStageResult extracted =
        ExtractStage(set_.panoramas, rectifier_, options_.extract, work_);
    timer.Done(set_.panoramas.size(), extracted.num_reused);
    report_.set_aside.insert(report_.set_aside.end(), extracted.set_aside.begin(),
                             extracted.set_aside.end());
    report_.without_depth = extracted.without_depth;
    panoramas_ = std::move(extracted.panoramas);
    RefuseTooManySetAside();
    // Bundle order: by tile, then id, so that a tile's panoramas are together.
    const auto key = [](const ExtractedPanorama& p) {
      return std::make_pair(Quadkey(p.record.position), p.record.id);
    };
    std::sort(
        panoramas_.begin(), panoramas_.end(),
        [&](const ExtractedPanorama& a, const ExtractedPanorama& b) { return key(a) < key(b); });
  }

  void RefuseTooManySetAside() const {
    const std::size_t num_stated = set_.panoramas.size() + set_.set_aside.size();
    const std::size_t num_bad = report_.set_aside.size();
    if (!panoramas_.empty() && static_cast<double>(num_bad) <=
                                   options_.max_set_aside_share * static_cast<double>(num_stated)) {
      return;
    }
    const SetAside& first = report_.set_aside.front();
    // The list is what helps now.
    ThrowIfError(WriteFileAtomically(options_.out.string() + ".report.json", report_.ToJson()));
    throw Error(
        ErrorCode::kBadData,
        Format("%s: %zu of %zu panoramas are unusable (first: %s: %s; all in %s.report.json); mend "
               "the data set or raise --max-set-aside-share",
               options_.panoramas.c_str(), num_bad, num_stated, first.id.c_str(),
               first.reason.c_str(), options_.out.c_str()));
  }

  void Place() {
    std::vector<PanoramaRecord> records;
    for (const ExtractedPanorama& p : panoramas_) {
      records.push_back(p.record);
      content_.tile_of_panorama.push_back(Quadkey(p.record.position));
    }
    const MapFrame frame = ChooseFrame(options_.map_frame, records);
    content_.manifest.map_frame = frame.parameters();
    content_.panoramas = PlacePanoramas(records, frame);
    for (std::size_t i = 0; i < panoramas_.size(); ++i) {
      content_.panoramas[i].has_depth = panoramas_[i].has_depth;
    }
    content_.directions = rectifier_.directions();
  }

  void Augment() {
    StageTimer timer(&report_, "augment", "panoramas");
    StationExtractOptions options;
    options.extract = options_.extract;
    options.render = options_.render;
    augmented_ = AugmentStage(panoramas_, rectifier_, options_.stations, options, work_);
    for (std::uint32_t p = 0; p < panoramas_.size(); ++p) {
      first_view_.push_back(static_cast<std::uint32_t>(content_.stations.size()) *
                            static_cast<std::uint32_t>(content_.directions.size()));
      for (const Station& station : augmented_.stations[p])
        content_.stations.push_back({p, station.position_in_pano});
    }
    timer.Done(panoramas_.size(), augmented_.num_reused);
  }

  [[nodiscard]] PanoramaFeatures Native(std::size_t p) const {
    return ValueOrThrow(ReadPanoramaFeatures(panoramas_[p].features_file));
  }
  [[nodiscard]] PanoramaFeatures Rendered(std::size_t p) const {
    if (augmented_.files[p].empty()) return {};
    return ValueOrThrow(ReadPanoramaFeatures(augmented_.files[p]));
  }

  void Train() {
    StageTimer timer(&report_, "train", "words");
    content_.vocabulary =
        TrainVocabulary(panoramas_, {options_.num_sift_words, options_.num_mser_words,
                                     options_.seed, options_.pack_descriptors});
    bags_ = MakeBags(
        panoramas_.size(),
        [this](std::size_t p) {
          return std::vector<PanoramaFeatures>{Native(p), Rendered(p)};
        },
        options_.max_words, &content_.vocabulary);
    timer.Done(content_.vocabulary.num_words());
  }

  // D_DB x r between the panoramas' own views; the stations beside them show the same.
  void IndexSimilarity() {
    StageTimer timer(&report_, "similarity", "views");
    const std::size_t per_station = content_.directions.size();
    std::vector<std::vector<std::uint32_t>> links;
    std::vector<std::array<double, 3>> positions;
    std::vector<std::uint32_t> panorama_of_view;
    std::vector<BagOfWords> bags;
    for (std::uint32_t p = 0; p < content_.panoramas.size(); ++p) {
      links.push_back(content_.panoramas[p].links);
      const Eigen::Vector3d& t = content_.panoramas[p].map_from_pano.translation;
      positions.push_back({t.x(), t.y(), t.z()});
      panorama_of_view.insert(panorama_of_view.end(), per_station, p);
      const auto first = bags_.begin() + static_cast<std::ptrdiff_t>(first_view_[p]);
      bags.insert(bags.end(), first, first + static_cast<std::ptrdiff_t>(per_station));
    }
    content_.similarity = BuildSimilarityIndex(
        bags, panorama_of_view,
        AppearanceNeighbourhoods(links, positions, options_.num_views, options_.similarity),
        options_.similarity);
    for (std::uint32_t& view : content_.similarity.views) {
      view = first_view_[view / per_station] + static_cast<std::uint32_t>(view % per_station);
    }
    timer.Done(bags.size());
  }

  void FillManifest() {
    Manifest& manifest = content_.manifest;
    manifest.name = options_.name.empty()
                        ? fs::absolute(options_.out).lexically_normal().filename().string()
                        : options_.name;
    manifest.build = options_.build;
    manifest.generator = kGenerator;
    manifest.camera = camera_;
    manifest.features = options_.extract.features;
    manifest.errors = options_.extract.errors;
    manifest.provenance = {set_.source, set_.licence, set_.height_datum, DataSetHash(panoramas_),
                           OptionsJson(options_)};
    manifest.num_set_aside = static_cast<std::int64_t>(report_.set_aside.size());
  }

  BundleTile MakeTile(std::size_t begin, std::size_t end, std::vector<MapPanorama>* panoramas) {
    const LandmarkStageInput input{[this](std::size_t p) { return Native(p); },
                                   [this](std::size_t p) { return Rendered(p); },
                                   content_,
                                   options_.extract.errors,
                                   rectifier_.camera(),
                                   options_.landmarks};
    BundleTile tile = MakeLandmarkTile(input, begin, end, panoramas, &report_.refined);
    const std::size_t last = end < panoramas_.size() ? first_view_[end] : bags_.size();
    if (options_.keep_view_images) {
      tile.view_images = EncodeViewImages(std::span(panoramas_).subspan(begin, end - begin),
                                          rectifier_, options_.extract.features);
    }
    tile.bags.assign(bags_.begin() + static_cast<std::ptrdiff_t>(first_view_[begin]),
                     bags_.begin() + static_cast<std::ptrdiff_t>(last));
    return tile;
  }

  void Publish() {
    StageTimer timer(&report_, "landmarks", "landmarks");
    FillManifest();
    content_.pack_descriptors = options_.pack_descriptors;
    Progress progress("landmarks", static_cast<std::int64_t>(panoramas_.size()), "panoramas");
    const Manifest written =
        WriteBundle(options_.out, content_,
                    [&](std::size_t begin, std::size_t end, std::vector<MapPanorama>* panoramas) {
                      BundleTile tile = MakeTile(begin, end, panoramas);
                      for (std::size_t p = begin; p < end; ++p) progress.Add();
                      return tile;
                    });
    progress.Finish();
    timer.Done(static_cast<std::size_t>(written.num_landmarks));
    report_.num_panoramas = written.num_panoramas;
    report_.num_stations = written.num_stations;
    report_.num_views = written.num_views;
    report_.num_landmarks = written.num_landmarks;
    const std::string text = ToJson(written);
    report_.bundle_id = Sha256Hex(text);
    report_.bundle_bytes = text.size();
    for (const BundlePart& part : written.parts) report_.bundle_bytes += part.num_bytes;
    report_.peak_memory_bytes = PeakMemoryBytes();
    ThrowIfError(WriteFileAtomically(options_.out.string() + ".report.json", report_.ToJson()));
  }

  const BuildOptions& options_;
  const fs::path work_;
  const Camera camera_;
  const Rectifier rectifier_;
  RunReport report_;
  PanoramaSet set_;
  std::vector<ExtractedPanorama> panoramas_;  // usable ones, in bundle order
  BundleContent content_;
  AugmentStageResult augmented_;
  std::vector<std::uint32_t> first_view_;  // of each panorama
  std::vector<BagOfWords> bags_;           // one a view
};

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
  require(max_words >= 0, Format("max_words = %d; must not be negative", max_words));
  require(build >= 0, "build must not be negative");
  require(max_set_aside_share >= 0 && max_set_aside_share <= 1,
          Format("max_set_aside_share = %g; must lie in [0, 1]", max_set_aside_share));
  require(num_threads >= 0, Format("num_threads = %d; must not be negative", num_threads));
  extract.Check();
  similarity.Check();
  stations.Check();
  render.Check();
  landmarks.Check();
}

RunReport Build(const BuildOptions& options) {
  options.Check();
  const unsigned threads = options.num_threads > 0 ? static_cast<unsigned>(options.num_threads)
                                                   : std::thread::hardware_concurrency();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
  ThrowIfError(CheckParentIsWritable(options.out, "--out"));
  RefuseForeignFolder(options.out);
  if (options.map_frame != "tangent") {
    const auto known = MapFrame::FromName(options.map_frame);
    if (!known.ok()) throw Error(ErrorCode::kInvalidArgument, known.status().message());
  }
  return BuildRun(options).Run();
}

}  // namespace panofix
