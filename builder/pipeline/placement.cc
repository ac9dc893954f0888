#include "builder/pipeline/placement.h"

#include <map>
#include <set>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

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

}  // namespace

MapFrame ChooseFrame(const std::string& name, const std::vector<PanoramaRecord>& panoramas) {
  if (name == "tangent") return MapFrame::Tangent(Centroid(panoramas));
  return ValueOrThrow(MapFrame::FromName(name));
}

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

}  // namespace panofix
