#include "builder/pipeline/landmark_stage.h"

#include <algorithm>
#include <unordered_map>

#include "common/map/local_frame.h"

namespace panofix {
namespace {

// Features held in memory while their observations refer to them.
struct Loaded {
  std::vector<PanoramaFeatures> features;  // native and rendered of each member
  std::vector<LandmarkObservation> observations;
};

class ObservationReader {
 public:
  ObservationReader(const LandmarkStageInput& input, const std::vector<std::uint32_t>& members)
      : input_(input), members_(members) {
    for (std::uint32_t m = 0; m < members.size(); ++m)
      member_of_id_[input.content.panoramas[members[m]].id] = m;
    first_station_.assign(input.content.panoramas.size() + 1, 0);
    for (const MapStation& station : input.content.stations)
      ++first_station_[station.panorama_idx + 1];
    for (std::size_t p = 1; p < first_station_.size(); ++p)
      first_station_[p] += first_station_[p - 1];
  }

  // Also collects each member's planes.
  Loaded Read(std::vector<LandmarkPanorama>* panoramas) const {
    Loaded loaded;
    loaded.features.reserve(2 * members_.size());
    for (std::size_t m = 0; m < members_.size(); ++m) {
      const std::uint32_t first_station = first_station_[members_[m]];
      loaded.features.push_back(input_.native(members_[m]));
      (*panoramas)[m].planes = loaded.features.back().planes;
      AddViews(loaded.features.back(), first_station, m, *panoramas, &loaded.observations);
      loaded.features.push_back(input_.rendered(members_[m]));
      AddViews(loaded.features.back(), first_station + 1, m, *panoramas, &loaded.observations);
    }
    return loaded;
  }

  [[nodiscard]] std::uint32_t FirstView(std::size_t panorama_idx) const {
    return first_station_[panorama_idx] *
           static_cast<std::uint32_t>(input_.content.directions.size());
  }

 private:
  // Views of a member's stations from `first_station` on.
  void AddViews(const PanoramaFeatures& features, std::uint32_t first_station, std::size_t member,
                const std::vector<LandmarkPanorama>& panoramas,
                std::vector<LandmarkObservation>* observations) const {
    const std::size_t per_station = input_.content.directions.size();
    for (std::size_t v = 0; v < features.views.size(); ++v) {
      const std::size_t station_idx = first_station + v / per_station;
      const Eigen::Vector3d station_in_local =
          panoramas[member].local_from_pano * input_.content.stations[station_idx].position_in_pano;
      const ViewFeatureSet& view = features.views[v];
      for (std::size_t i = 0; i < view.sift.size(); ++i) {
        const SurfacePoint& point = view.points[i];
        if (point.range_sigma_m <= 0) continue;
        const auto source = member_of_id_.find(features.sources[point.source_idx]);
        if (source == member_of_id_.end()) continue;  // beyond the halo
        const Eigen::Vector3d at =
            panoramas[source->second].local_from_pano * point.point_in_pano.cast<double>();
        const Keypoint& k = view.sift.keypoints[i];
        LandmarkObservation o{
            static_cast<std::uint32_t>(station_idx * per_station + v % per_station),
            source->second,
            point.surface_idx,
            point.point_in_pano,
            point.range_sigma_m,
            static_cast<float>(double{k.size_px} / input_.view_camera.fx_px *
                               (at - station_in_local).norm()),
            k.angle_deg,
            k.response,
            std::span<const std::uint8_t, kDescriptorSize>(view.sift.descriptor(i))};
        observations->push_back(o);
      }
    }
  }

  const LandmarkStageInput& input_;
  const std::vector<std::uint32_t>& members_;
  std::unordered_map<std::string, std::uint32_t> member_of_id_;
  std::vector<std::uint32_t> first_station_;
};

// Landmarks with a view of the tile, with those views only and the bundle's panorama numbers.
void KeepOwn(LandmarkLayer* layer, const std::vector<std::uint32_t>& members,
             std::uint32_t first_view, std::uint32_t end_view, BundleTile* tile) {
  for (Landmark& landmark : layer->landmarks) {
    std::erase_if(landmark.views, [&](std::uint32_t v) { return v < first_view || v >= end_view; });
    if (landmark.views.empty()) continue;
    landmark.panorama = members[landmark.panorama];
    tile->landmarks.push_back(std::move(landmark));
  }
  std::stable_sort(tile->landmarks.begin(), tile->landmarks.end(),
                   [](const Landmark& a, const Landmark& b) { return a.panorama < b.panorama; });
}

}  // namespace

std::vector<std::uint32_t> TileMembers(const std::vector<MapPanorama>& panoramas, std::size_t begin,
                                       std::size_t end, double halo_m) {
  std::vector<std::uint32_t> members;
  for (std::size_t p = begin; p < end; ++p) members.push_back(static_cast<std::uint32_t>(p));
  for (std::uint32_t p = 0; p < panoramas.size(); ++p) {
    if (p >= begin && p < end) continue;
    const bool is_near = std::any_of(
        panoramas.begin() + static_cast<std::ptrdiff_t>(begin),
        panoramas.begin() + static_cast<std::ptrdiff_t>(end), [&](const MapPanorama& own) {
          return (own.map_from_pano.translation - panoramas[p].map_from_pano.translation)
                     .head<2>()
                     .norm() < halo_m * own.point_scale;
        });
    if (is_near) members.push_back(p);
  }
  return members;
}

BundleTile MakeLandmarkTile(const LandmarkStageInput& input, std::size_t begin, std::size_t end,
                            std::vector<MapPanorama>* panoramas,
                            std::vector<RefinementReport>* report) {
  const std::vector<std::uint32_t> members =
      TileMembers(input.content.panoramas, begin, end, input.halo_m);
  const LocalFrame local = LocalFrame::At(input.content.panoramas[members.front()]);
  std::vector<LandmarkPanorama> given(members.size());
  for (std::size_t m = 0; m < members.size(); ++m) {
    given[m].local_from_pano = local.LocalFromPano(input.content.panoramas[members[m]]);
    given[m].is_fixed = m >= end - begin;
  }
  const ObservationReader reader(input, members);
  const Loaded loaded = reader.Read(&given);
  LandmarkLayer layer = BuildLandmarks(given, loaded.observations, input.errors,
                                       input.view_camera.fx_px, input.options);
  BundleTile tile;
  KeepOwn(&layer, members, reader.FirstView(begin), reader.FirstView(end), &tile);
  std::vector<char> is_anchor(members.size(), 0);
  std::unordered_map<std::uint32_t, std::size_t> member_of;
  for (std::size_t m = 0; m < members.size(); ++m) member_of[members[m]] = m;
  for (const Landmark& landmark : tile.landmarks) is_anchor[member_of.at(landmark.panorama)] = 1;
  for (std::size_t m = 0; m < members.size(); ++m) {
    const PanoramaRefinement& refined = layer.panoramas[m];
    if (is_anchor[m] != 0) {
      tile.anchors.push_back(
          {members[m], refined.planes, refined.distance_sigma_share, refined.normal_sigma_rad});
    }
    if (given[m].is_fixed) continue;
    MapPanorama& panorama = (*panoramas)[members[m]];
    panorama.is_flagged = refined.is_flagged;
    panorama.map_from_pano = {refined.local_from_pano.rotation,
                              local.ToMap(refined.local_from_pano.translation)};
    report->push_back({panorama.id, refined.shift_m, refined.turn_deg, refined.residual_before_px,
                       refined.residual_after_px, refined.num_tracks, refined.is_flagged});
  }
  std::sort(tile.anchors.begin(), tile.anchors.end(),
            [](const auto& a, const auto& b) { return a.panorama_idx < b.panorama_idx; });
  return tile;
}

}  // namespace panofix
