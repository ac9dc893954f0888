// The per-panorama file of extracted features: HDF5, described in schemas/work_files.md.
#include "builder/extract/panorama_features.h"
#include "common/base/log.h"
#include "common/io/hdf5_file.h"

#include <algorithm>

namespace panofix {
namespace {

std::vector<float> Flatten(const std::vector<Keypoint>& keypoints) {
  std::vector<float> values;
  values.reserve(keypoints.size() * 5);
  for (const Keypoint& k : keypoints) {
    values.insert(values.end(), {k.x_px, k.y_px, k.size_px, k.angle_deg, k.response});
  }
  return values;
}

Result<FeatureSet> ReadSet(const Hdf5Reader& file, const std::string& group) {
  const auto keypoints = file.Read<float>(group + "/keypoints", 5);
  if (!keypoints.ok()) return keypoints.status();
  const auto descriptors = file.Read<std::uint8_t>(group + "/descriptors", kDescriptorSize);
  if (!descriptors.ok()) return descriptors.status();
  if (keypoints->rows != descriptors->rows)
    return Status(ErrorCode::kBadData, group + ": rows disagree");
  FeatureSet set;
  for (std::int64_t i = 0; i < keypoints->rows; ++i) {
    const float* v = &keypoints->values[static_cast<std::size_t>(i) * 5];
    set.keypoints.push_back({v[0], v[1], v[2], v[3], v[4]});
  }
  set.descriptors.assign(descriptors->values.begin(), descriptors->values.end());
  return set;
}

void WriteSet(Hdf5Writer* file, const std::string& group, const FeatureSet& set) {
  file->Write<float>(group + "/keypoints", Flatten(set.keypoints), 5);
  file->Write<std::uint8_t>(group + "/descriptors", set.descriptors, kDescriptorSize);
}

}  // namespace

void WritePanoramaFeatures(const std::filesystem::path& path, const PanoramaFeatures& features) {
  Hdf5Writer file(path);
  file.WriteAttribute("has_depth", features.has_depth ? 1 : 0);
  file.WriteAttribute("depth_fault", features.depth_fault);
  file.WriteAttribute("num_views", static_cast<std::int64_t>(features.views.size()));
  std::vector<float> planes;
  for (const DepthPlane& plane : features.planes) {
    const Eigen::Vector3f& n = plane.normal_in_pano;
    planes.insert(planes.end(), {n.x(), n.y(), n.z(), plane.d_m});
  }
  file.Write<float>("planes", planes, 4);
  file.WriteStrings("sources", features.sources);
  for (std::size_t v = 0; v < features.views.size(); ++v) {
    const std::string group = Format("view%03zu", v);
    WriteSet(&file, group + "/sift", features.views[v].sift);
    WriteSet(&file, group + "/mser", features.views[v].mser);
    std::vector<float> points;
    std::vector<std::uint8_t> surfaces, sources;
    for (const SurfacePoint& p : features.views[v].points) {
      points.insert(points.end(), {p.point_in_pano.x(), p.point_in_pano.y(), p.point_in_pano.z(),
                                   p.range_sigma_m});
      surfaces.push_back(p.surface_idx);
      sources.push_back(p.source_idx);
    }
    file.Write<std::uint8_t>(group + "/surfaces", surfaces);
    file.Write<std::uint8_t>(group + "/sources", sources);
    file.Write<float>(group + "/points", points, 4);
  }
  file.Close();
}

Result<PanoramaFeatures> ReadPanoramaFeatures(const std::filesystem::path& path) {
  auto file = Hdf5Reader::Open(path);
  if (!file.ok()) return file.status();
  PanoramaFeatures features;
  const auto has_depth = file->ReadIntAttribute("has_depth");
  const auto num_views = file->ReadIntAttribute("num_views");
  auto fault = file->ReadStringAttribute("depth_fault");
  if (!has_depth.ok() || !num_views.ok() || !fault.ok()) {
    return Status(ErrorCode::kBadData,
                  path.string() + ": attributes are missing; delete it and build again");
  }
  features.has_depth = *has_depth != 0;
  features.depth_fault = std::move(fault).value();
  auto source_ids = file->ReadStrings("sources");
  if (!source_ids.ok()) return source_ids.status();
  features.sources = std::move(source_ids).value();
  const auto planes = file->Read<float>("planes", 4);
  if (!planes.ok()) return planes.status();
  for (std::int64_t i = 0; i < planes->rows; ++i) {
    const float* p = &planes->values[static_cast<std::size_t>(i) * 4];
    features.planes.push_back({Eigen::Vector3f(p[0], p[1], p[2]), p[3]});
  }
  for (std::int64_t v = 0; v < *num_views; ++v) {
    const std::string group = Format("view%03ld", static_cast<long>(v));
    auto sift = ReadSet(*file, group + "/sift");
    if (!sift.ok()) return sift.status();
    auto mser = ReadSet(*file, group + "/mser");
    if (!mser.ok()) return mser.status();
    const auto points = file->Read<float>(group + "/points", 4);
    if (!points.ok()) return points.status();
    ViewFeatureSet set{std::move(sift).value(), {}, std::move(mser).value()};
    const auto surfaces = file->Read<std::uint8_t>(group + "/surfaces");
    if (!surfaces.ok()) return surfaces.status();
    const auto sources = file->Read<std::uint8_t>(group + "/sources");
    if (!sources.ok()) return sources.status();
    if (surfaces->rows != points->rows || sources->rows != points->rows ||
        points->rows != static_cast<std::int64_t>(set.sift.size())) {
      return Status(ErrorCode::kBadData,
                    path.string() + ": rows disagree; delete it and build again");
    }
    const auto known = [&](std::uint8_t source) { return source < features.sources.size(); };
    if (!std::all_of(sources->values.begin(), sources->values.end(), known)) {
      return Status(ErrorCode::kBadData,
                    path.string() + ": a source is not listed; delete it and build again");
    }
    for (std::size_t i = 0; i < set.sift.size(); ++i) {
      const float* p = &points->values[4 * i];
      set.points.push_back(
          {Eigen::Vector3f(p[0], p[1], p[2]), p[3], surfaces->values[i], sources->values[i]});
    }
    features.views.push_back(std::move(set));
  }
  return features;
}

}  // namespace panofix
