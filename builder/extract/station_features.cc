#include "builder/extract/station_features.h"

#include <algorithm>
#include <stdexcept>

#include "common/base/log.h"

namespace panofix {
namespace {

// A descriptor looks this many keypoint diameters around; its weight has fallen to a third there.
constexpr double kDescribedRadius = 1.5;

// Sources of one station, nearest first.
struct Choice {
  std::vector<std::uint8_t> indices;
  std::vector<const RenderSource*> contents;
  std::vector<Rigid3> station_from_source;
};

Choice ChooseSources(const Station& station, const std::vector<StationSource>& sources,
                     const StationExtractOptions& options) {
  std::vector<std::pair<double, std::size_t>> near;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    const double distance_m =
        (sources[i].owner_from_source.translation - station.position_in_pano).norm();
    if (distance_m <= options.max_distance_m) near.emplace_back(distance_m, i);
  }
  std::sort(near.begin(), near.end());
  near.resize(std::min(near.size(), static_cast<std::size_t>(options.max_sources)));
  Choice choice;
  for (const auto& [distance_m, i] : near) {
    choice.indices.push_back(static_cast<std::uint8_t>(i));
    choice.contents.push_back(sources[i].content.get());
    const Rigid3& owner_from_source = sources[i].owner_from_source;
    choice.station_from_source.emplace_back(
        owner_from_source.rotation, owner_from_source.translation - station.position_in_pano);
  }
  return choice;
}

void Append(const FeatureSet& from, std::size_t i, FeatureSet* to) {
  to->keypoints.push_back(from.keypoints[i]);
  const auto descriptor = from.descriptor(i);
  to->descriptors.insert(to->descriptors.end(), descriptor.begin(), descriptor.end());
}

ViewFeatureSet ExtractRendered(const RenderedView& rendered, const Choice& choice,
                               const StationExtractOptions& options) {
  ViewFeatureSet kept;
  if (rendered.coverage() < options.min_coverage) return kept;
  FeatureOptions features = options.extract.features;
  features.max_sift = std::min(features.max_sift, options.max_sift);
  const GrayImage image = Preprocess(rendered.image, features);
  const FeatureSet sift = ExtractSift(image, features), mser = ExtractMser(image, features);
  for (std::size_t i = 0; i < sift.size(); ++i) {
    const Keypoint& k = sift.keypoints[i];
    const Eigen::Vector2d px(k.x_px, k.y_px);
    const auto seen = rendered.At(px);
    if (!seen || !rendered.IsWhole(px, kDescribedRadius * double{k.size_px})) continue;
    const auto source = static_cast<std::size_t>(seen->source_idx);
    auto point = PointOnSurface(choice.contents[source]->depth(),
                                seen->point_in_source.normalized(), options.extract);
    if (!point) continue;
    point->source_idx = choice.indices[source];
    Append(sift, i, &kept.sift);
    kept.points.push_back(*point);
  }
  for (std::size_t i = 0; i < mser.size(); ++i) {
    const Keypoint& k = mser.keypoints[i];
    if (rendered.IsWhole({k.x_px, k.y_px}, 0.5 * double{k.size_px})) Append(mser, i, &kept.mser);
  }
  return kept;
}

}  // namespace

void StationExtractOptions::Check() const {
  extract.Check();
  render.Check();
  if (max_sift < 50) throw std::invalid_argument(Format("max_sift = %d; at least 50", max_sift));
  if (max_sources < 1 || max_sources > 255)
    throw std::invalid_argument(Format("max_sources = %d; must lie in 1..255", max_sources));
}

PanoramaFeatures ExtractStations(const std::vector<Station>& stations,
                                 const std::vector<StationSource>& sources,
                                 const Camera& view_camera,
                                 const std::vector<ViewDirection>& directions,
                                 const StationExtractOptions& options) {
  const ViewRenderer renderer(view_camera, directions, options.render);
  PanoramaFeatures result;
  for (const StationSource& source : sources) result.sources.push_back(source.id);
  result.has_depth = !sources.empty();
  for (const Station& station : stations) {
    const Choice choice = ChooseSources(station, sources, options);
    for (int v = 0; v < static_cast<int>(directions.size()); ++v) {
      result.views.push_back(
          choice.contents.empty()
              ? ViewFeatureSet{}
              : ExtractRendered(renderer.Render(choice.contents, choice.station_from_source, v),
                                choice, options));
    }
  }
  return result;
}

}  // namespace panofix
