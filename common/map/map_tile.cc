#include "common/map/map_tile.h"

#include "common/map/landmark_codes.h"
#include "common/map/landmark_words.h"
#include "common/map/map_arrays.h"

namespace panofix {

using namespace map_internal;

namespace {

// Columns of landmarks/codes.
enum Code { kRangeSigma, kPointSigma, kSize, kAngle, kSurface, kNumPanoramas, kNumCodes };

Status LookUp(const Hdf5Reader& file, const std::string& name,
              const std::unordered_map<std::string, std::uint32_t>& panorama_idx,
              std::vector<std::uint32_t>* indices) {
  auto ids = file.ReadStrings(name);
  if (!ids.ok()) return ids.status();
  for (const std::string& id : *ids) {
    const auto found = panorama_idx.find(id);
    if (found == panorama_idx.end()) return Bad("panorama " + id + " is not in graph.h5");
    indices->push_back(found->second);
  }
  return {};
}

}  // namespace

Result<MapTile> MapTile::Load(const Hdf5Reader& file,
                              const std::unordered_map<std::string, std::uint32_t>& panorama_idx,
                              const Vocabulary& vocabulary) {
  MapTile tile;
  Status status = LookUp(file, "panorama_ids", panorama_idx, &tile.panoramas_);
  if (status.ok()) status = LookUp(file, "anchors/panorama_ids", panorama_idx, &tile.anchors_);
  if (status.ok()) status = tile.LoadLandmarks(file);
  if (status.ok()) status = tile.LoadWords(file, vocabulary.sift.num_words);
  if (status.ok()) status = tile.LoadSurfaces(file);
  if (status.ok()) status = tile.LoadBags(file, vocabulary.num_words());
  if (!status.ok()) return status;
  return tile;
}

MapTile MapTile::Blank(std::size_t num_views) {
  const auto zeros = std::make_shared<std::vector<std::uint32_t>>(num_views + 1, 0);
  MapTile tile;
  tile.view_offsets_ = {*zeros, static_cast<std::int64_t>(zeros->size()), 1, zeros};
  tile.bag_offsets_ = tile.view_offsets_;
  return tile;
}

Status MapTile::LoadLandmarks(const Hdf5Reader& file) {
  PANOFIX_READ(anchor_offsets, file, std::uint32_t, "anchors/landmark_offsets", 1);
  PANOFIX_READ(points, file, float, "landmarks/points_in_pano", 3);
  PANOFIX_READ(codes, file, std::uint8_t, "landmarks/codes", kNumCodes);
  PANOFIX_READ(descriptors, file, std::uint8_t, "landmarks/descriptors", -1);
  PANOFIX_READ(view_offsets, file, std::uint32_t, "views/landmark_offsets", 1);
  PANOFIX_READ(view_landmarks, file, std::uint32_t, "views/landmarks", 1);
  const auto rows = static_cast<std::size_t>(points.rows);
  is_packed_ = descriptors.cols == kPackedDescriptorSize;
  if (codes.rows != points.rows || descriptors.rows != points.rows ||
      (!is_packed_ && descriptors.cols != kDescriptorSize) ||
      !AreOffsets(anchor_offsets.values, anchors_.size(), rows)) {
    return Bad("landmark arrays disagree");
  }
  if (view_offsets.values.empty() ||
      !AreOffsets(view_offsets.values, view_offsets.values.size() - 1,
                  view_landmarks.values.size()) ||
      !AllBelow(view_landmarks.values, rows)) {
    return Bad("a view's landmarks lie outside the landmarks");
  }
  if (!AllFinite(points.values)) return Bad("landmarks are not finite");
  anchor_offsets_ = std::move(anchor_offsets);
  points_ = std::move(points);
  codes_ = std::move(codes);
  descriptors_ = std::move(descriptors);
  view_offsets_ = std::move(view_offsets);
  view_landmarks_ = std::move(view_landmarks);
  return {};
}

// Older minor versions have none.
Status MapTile::LoadWords(const Hdf5Reader& file, std::uint32_t num_sift_words) {
  auto words = file.Read<std::uint32_t>("landmarks/words", 1);
  if (words.status().code() == ErrorCode::kNotFound) return {};
  if (!words.ok()) return words.status();
  if (words->rows != points_.rows || !AllBelow(words->values, num_sift_words))
    return Bad("words of landmarks disagree");
  words_ = std::move(words).value();
  return {};
}

Status MapTile::LoadSurfaces(const Hdf5Reader& file) {
  PANOFIX_READ(offsets, file, std::uint32_t, "anchors/plane_offsets", 1);
  PANOFIX_READ(planes, file, float, "anchors/planes", 6);
  if (!AreOffsets(offsets.values, anchors_.size(), static_cast<std::size_t>(planes.rows)))
    return Bad("depth planes disagree");
  for (std::size_t a = 0; a < anchors_.size(); ++a) {
    auto& surfaces = surfaces_[anchors_[a]];
    if (!surfaces.empty()) return Bad("an anchor is listed twice");
    for (std::uint32_t i = offsets.values[a]; i < offsets.values[a + 1]; ++i) {
      const float* plane = &planes.values[6 * std::size_t{i}];
      const Eigen::Vector3d normal(plane[0], plane[1], plane[2]);
      const double length = normal.norm();
      MapSurface surface;
      // Plane 0 is unused and may be anything.
      const bool is_plane = length > 0.5 && length < 2.0 && plane[4] >= 0 && plane[4] < 10 &&
                            plane[5] >= 0 && plane[5] < 10;
      if (is_plane) surface = {normal / length, double{plane[4]}, double{plane[5]}};
      surfaces.push_back(surface);
    }
  }
  return {};
}

Status MapTile::LoadBags(const Hdf5Reader& file, std::uint32_t num_words) {
  PANOFIX_READ(offsets, file, std::uint32_t, "bags/offsets", 1);
  PANOFIX_READ(words, file, std::uint32_t, "bags/words", 1);
  PANOFIX_READ(weights, file, std::uint8_t, "bags/weights", 1);
  if (weights.rows != words.rows || !AllBelow(words.values, num_words) ||
      !AreOffsets(offsets.values, num_views(), words.values.size())) {
    return Bad("bags of words disagree");
  }
  bag_offsets_ = std::move(offsets);
  bag_words_ = std::move(words);
  bag_weights_ = std::move(weights);
  return {};
}

MapLandmark MapTile::Landmark(std::size_t i) const {
  if (i >= num_landmarks()) return {};
  const float* point = &points_.values[3 * i];
  const std::uint8_t* code = &codes_.values[kNumCodes * i];
  MapLandmark landmark;
  const std::span<const std::uint32_t> offsets = anchor_offsets_.values;
  const auto after = std::upper_bound(offsets.begin(), offsets.end(), i);
  landmark.panorama_idx = anchors_[static_cast<std::size_t>(after - offsets.begin()) - 1];
  landmark.point_in_pano = Eigen::Vector3f(point).cast<double>();
  landmark.range_sigma_m = DecodeLength(code[kRangeSigma]);
  landmark.point_sigma_m = DecodeLength(code[kPointSigma]);
  landmark.size_m = DecodeLength(code[kSize]);
  landmark.angle_deg = DecodeAngle(code[kAngle]);
  landmark.surface_idx = code[kSurface];
  landmark.num_panoramas = std::max<int>(1, code[kNumPanoramas]);
  return landmark;
}

std::uint8_t MapTile::AngleCode(std::size_t i) const {
  return codes_.values[kNumCodes * i + kAngle];
}

void MapTile::PrefetchDescriptor(std::size_t i) const {
  __builtin_prefetch(&descriptors_.values[static_cast<std::size_t>(descriptors_.cols) * i]);
}

void MapTile::Descriptor(std::size_t i, std::uint8_t* descriptor) const {
  if (i >= num_landmarks()) {
    std::fill_n(descriptor, kDescriptorSize, std::uint8_t{0});
  } else if (is_packed_) {
    UnpackDescriptor(&descriptors_.values[kPackedDescriptorSize * i], descriptor);
  } else {
    std::copy_n(&descriptors_.values[kDescriptorSize * i], kDescriptorSize, descriptor);
  }
}

std::vector<std::uint32_t> MapTile::DeriveWords(const VocabularyTree& sift) const {
  return WordsOfDescriptors(sift, descriptors_.values, descriptors_.cols);
}

BagOfWords MapTile::Bag(std::size_t slot) const {
  BagOfWords bag;
  bag.reserve(bag_offsets_.values[slot + 1] - bag_offsets_.values[slot]);
  double sum_sq = 0;
  for (std::uint32_t i = bag_offsets_.values[slot]; i < bag_offsets_.values[slot + 1]; ++i) {
    const auto weight = static_cast<float>(bag_weights_.values[i]);
    bag.push_back({bag_words_.values[i], weight});
    sum_sq += double{weight} * double{weight};
  }
  const auto scale = static_cast<float>(sum_sq > 0 ? 1 / std::sqrt(sum_sq) : 0);
  for (WeightedWord& word : bag) word.weight *= scale;
  return bag;
}

MapSurface MapTile::Surface(std::uint32_t panorama_idx, int surface_idx) const {
  const auto found = surfaces_.find(panorama_idx);
  if (found == surfaces_.end() || static_cast<std::size_t>(surface_idx) >= found->second.size())
    return {};
  return found->second[static_cast<std::size_t>(surface_idx)];
}

#undef PANOFIX_READ

}  // namespace panofix
