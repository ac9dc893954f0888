#include "runtime/retrieval/landmark_votes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "common/features/matcher.h"
#include "common/geometry/attitude.h"
#include "common/map/landmark_codes.h"

namespace panofix {

// One keypoint's vote for a view, at a turn of the camera against it.
struct Vote {
  std::uint32_t view = 0;
  std::int32_t bin = 0;
  float weight = 0;
};

namespace {

// The codes of orientations no further than `max_turn_deg` from `angle_deg`.
Voters::Codes CodesWithin(double angle_deg, double max_turn_deg) {
  const int nearest = EncodeAngle(angle_deg);
  const auto is_within = [&](int code) {
    const double turn_deg =
        AngleDifferenceDeg(angle_deg, DecodeAngle(static_cast<std::uint8_t>(code & 255)));
    return std::abs(turn_deg) <= max_turn_deg;
  };
  if (!is_within(nearest)) return {};
  int below = 0, above = 0;
  while (below < 255 && is_within(nearest - below - 1)) ++below;
  while (below + above < 255 && is_within(nearest + above + 1)) ++above;
  return {static_cast<std::uint8_t>((nearest - below) & 255), below + above + 1};
}

}  // namespace

Voters::Voters(const Vocabulary& vocabulary, const FeatureSet& sift_features,
               std::span<const Eigen::Vector2d> keypoint_bearings, const Camera& frame_camera,
               const VoteOptions& options)
    : sift(sift_features),
      bearings(keypoint_bearings),
      camera(frame_camera),
      words(sift_features.size()),
      angles(sift_features.size()) {
  tbb::parallel_for(std::size_t{0}, words.size(), [&](std::size_t k) {
    vocabulary.sift.QuantizeSoft(sift.descriptor(k).data(), options.num_words, &words[k]);
    angles[k] = CodesWithin(double{sift.keypoints[k].angle_deg}, options.max_turn_deg);
  });
}

TileVotes::TileVotes(const MapBundle& bundle, std::size_t tile_idx,
                     std::span<const std::uint32_t> words, const LocalFrame& local,
                     const VoteOptions& options)
    : bundle_(bundle), tile_(tile_idx), options_(options) {
  const MapTile& tile = bundle_.tiles().Get(tile_);
  // A tile that was lost since its words were taken has none.
  const std::size_t n = std::min(tile.num_landmarks(), words.size());
  AddWords(tile, words.first(n));
  for (const std::uint32_t anchor : tile.anchors())
    local_from_anchor_.push_back(local.LocalFromPano(bundle_.panoramas()[anchor]));
  view_offsets_.assign(n + 1, 0);
  AddViews(tile, local);
}

void TileVotes::AddWords(const MapTile& tile, std::span<const std::uint32_t> words) {
  // Counting sort: words are many and their numbers few.
  std::vector<std::uint32_t> next(bundle_.vocabulary().sift.num_words, 0);
  for (const std::uint32_t word : words) ++next[word];
  const auto num_rows = next.size() - static_cast<std::size_t>(
                                          std::count(next.begin(), next.end(), std::uint32_t{0}));
  // Two numbers a word that is there, or one for each.
  const bool is_sparse = 2 * num_rows < next.size();
  words_.reserve(is_sparse ? num_rows : 0);
  word_offsets_.reserve((is_sparse ? num_rows : next.size()) + 1);
  std::uint32_t begin = 0;
  for (std::uint32_t word = 0; word < next.size(); ++word) {
    const std::uint32_t count = std::exchange(next[word], begin);
    if (is_sparse && count > 0) words_.push_back(word);
    if (!is_sparse || count > 0) word_offsets_.push_back(begin);
    begin += count;
  }
  word_offsets_.push_back(begin);
  landmarks_of_word_.resize(words.size()), angles_.resize(words.size());
  for (std::uint32_t i = 0; i < words.size(); ++i) {
    const std::uint32_t at = next[words[i]]++;
    landmarks_of_word_[at] = i;
    angles_[at] = tile.AngleCode(i);
  }
}

std::pair<std::uint32_t, std::uint32_t> TileVotes::RowsOf(std::uint32_t word) const {
  std::size_t row = word;
  if (!words_.empty()) {
    const auto found = std::lower_bound(words_.begin(), words_.end(), word);
    if (found == words_.end() || *found != word) return {0, 0};
    row = static_cast<std::size_t>(found - words_.begin());
  }
  if (row + 1 >= word_offsets_.size()) return {0, 0};
  return {word_offsets_[row], word_offsets_[row + 1]};
}

void TileVotes::AddViews(const MapTile& tile, const LocalFrame& local) {
  const auto num_views = static_cast<std::uint32_t>(tile.num_views());
  norm_.reserve(num_views), poses_.reserve(num_views);
  std::size_t num_entries = 0;
  for (std::uint32_t slot = 0; slot < num_views; ++slot) {
    const std::span<const std::uint32_t> list = tile.LandmarksOf(slot);
    for (const std::uint32_t landmark : list) ++view_offsets_[landmark + 1];
    num_entries += list.size();
    norm_.push_back(1 / std::sqrt(50.0F + static_cast<float>(list.size())));
    AddView(bundle_.ViewsOfTile(tile_)[slot], local);
  }
  for (std::size_t i = 1; i < view_offsets_.size(); ++i) view_offsets_[i] += view_offsets_[i - 1];
  views_of_landmark_.resize(num_entries);
  std::vector<std::uint32_t> next(view_offsets_.begin(), view_offsets_.end() - 1);
  for (std::uint32_t slot = 0; slot < num_views; ++slot) {
    for (const std::uint32_t landmark : tile.LandmarksOf(slot))
      views_of_landmark_[next[landmark]++] = slot;
  }
}

void TileVotes::AddView(std::uint32_t view_idx, const LocalFrame& local) {
  const MapView& view = bundle_.views()[view_idx];
  const Rigid3 local_from_pano = local.LocalFromPano(bundle_.panoramas()[view.panorama_idx]);
  const Eigen::Matrix3d local_from_cam =
      local_from_pano.rotation * EnuFromBody({view.yaw_deg, view.pitch_deg, 0}) * BodyFromCam();
  const Eigen::Vector3d centre =
      local_from_pano * bundle_.stations()[view.station_idx].position_in_pano;
  poses_.push_back({local_from_cam.transpose().cast<float>(), centre.cast<float>()});
}

void TileVotes::VoteFor(const MapTile& tile, const Voters& voters, std::size_t keypoint_idx,
                        double across_rad, double up_rad, std::uint32_t landmark_idx, float weight,
                        const std::vector<char>& wanted, std::vector<Vote>* votes) const {
  const Keypoint& keypoint = voters.sift.keypoints[keypoint_idx];
  const std::vector<std::uint32_t>& views = bundle_.ViewsOfTile(tile_);
  const MapLandmark landmark = tile.Landmark(landmark_idx);
  const auto anchor =
      std::upper_bound(tile.anchor_offsets().begin(), tile.anchor_offsets().end(), landmark_idx) -
      tile.anchor_offsets().begin() - 1;
  const Eigen::Vector3f point =
      (local_from_anchor_[static_cast<std::size_t>(anchor)] * landmark.point_in_pano).cast<float>();
  const double size_m = double{static_cast<float>(landmark.size_m)};
  for (std::uint32_t i = view_offsets_[landmark_idx]; i < view_offsets_[landmark_idx + 1]; ++i) {
    const std::uint32_t view = views_of_landmark_[i];
    if (!wanted.empty() && wanted[views[view]] == 0) continue;
    const ViewPose& pose = poses_[view];
    const Eigen::Vector3f x = pose.cam_from_map * (point - pose.centre);
    if (x.z() < 0.3F) continue;
    const double ratio =
        double{keypoint.size_px} * double{x.norm()} / (size_m * voters.camera.fx_px);
    if (ratio > options_.max_size_ratio || ratio * options_.max_size_ratio < 1) continue;
    const double up_deg = (up_rad - std::atan2(double{x.y()}, double{x.z()})) / kRadPerDeg;
    if (std::abs(up_deg) > options_.max_up_deg) continue;
    const double across_deg = (across_rad - std::atan2(double{x.x()}, double{x.z()})) / kRadPerDeg;
    if (std::abs(across_deg) > options_.max_across_deg) continue;
    votes->push_back({view, static_cast<std::int32_t>(std::floor(across_deg / options_.bin_deg)),
                      weight * norm_[view]});
  }
}

template <typename Visit>
void TileVotes::ForEachAlike(const MapTile& tile, const Voters& voters, std::size_t keypoint,
                             const Visit& visit) const {
  const double limit_sq = options_.max_descriptor_distance * options_.max_descriptor_distance;
  const double sigma = options_.descriptor_sigma;
  const std::uint8_t* descriptor = voters.sift.descriptor(keypoint).data();
  const Voters::Codes angles = voters.angles[keypoint];
  // In two steps: descriptors lie anywhere in the tile and are on their way by the second.
  thread_local std::vector<std::uint32_t> candidates;
  candidates.clear();
  for (const std::uint32_t word : voters.words[keypoint]) {
    const auto [begin, end] = RowsOf(word);
    for (std::uint32_t i = begin; i < end; ++i) {
      if (static_cast<std::uint8_t>(angles_[i] - angles.first) >= angles.count) continue;
      candidates.push_back(landmarks_of_word_[i]);
      tile.PrefetchDescriptor(candidates.back());
    }
  }
  std::uint8_t other[kDescriptorSize];
  for (const std::uint32_t landmark : candidates) {
    tile.Descriptor(landmark, other);
    const int distance_sq = DescriptorDistanceSq(descriptor, other);
    if (distance_sq <= limit_sq)
      visit(landmark, static_cast<float>(std::exp(-distance_sq / (2 * sigma * sigma))));
  }
}

std::vector<float> TileVotes::Count(std::vector<std::vector<Vote>> votes) const {
  const int half = static_cast<int>(std::ceil(options_.max_across_deg / options_.bin_deg));
  const auto num_bins = static_cast<std::size_t>(2 * half + 1);
  std::vector<float> bins(poses_.size() * num_bins, 0);
  for (auto& of_keypoint : votes) {
    // A keypoint shows one thing: of its votes for a view the best counts (burstiness).
    std::sort(of_keypoint.begin(), of_keypoint.end(), [](const Vote& a, const Vote& b) {
      return std::make_tuple(a.view, -a.weight, a.bin) < std::make_tuple(b.view, -b.weight, b.bin);
    });
    std::uint32_t last = ~0U;
    for (const Vote& vote : of_keypoint) {
      if (vote.view == last) continue;
      last = vote.view;
      bins[vote.view * num_bins + static_cast<std::size_t>(vote.bin + half)] += vote.weight;
    }
  }
  std::vector<float> scores(poses_.size(), 0);
  for (std::size_t v = 0; v < scores.size(); ++v) {
    for (std::size_t b = 0; b + 1 < num_bins; ++b)
      scores[v] = std::max(scores[v], bins[v * num_bins + b] + bins[v * num_bins + b + 1]);
  }
  return scores;
}

void TileVotes::Score(const Voters& voters, const std::vector<char>& wanted,
                      std::vector<float>* scores) const {
  const MapTile& tile = bundle_.tiles().Get(tile_);
  if (tile.num_landmarks() + 1 < view_offsets_.size()) return;  // lost since
  std::vector<std::vector<Vote>> votes(voters.sift.size());
  tbb::parallel_for(std::size_t{0}, voters.sift.size(), [&](std::size_t k) {
    const double across_rad = std::atan(voters.bearings[k].x()),
                 up_rad = std::atan(voters.bearings[k].y());
    ForEachAlike(tile, voters, k, [&](std::uint32_t landmark, float weight) {
      VoteFor(tile, voters, k, across_rad, up_rad, landmark, weight, wanted, &votes[k]);
    });
  });
  const std::vector<float> of_slot = Count(std::move(votes));
  const std::vector<std::uint32_t>& views = bundle_.ViewsOfTile(tile_);
  for (std::size_t slot = 0; slot < of_slot.size(); ++slot) (*scores)[views[slot]] = of_slot[slot];
}

std::size_t TileVotes::num_bytes() const {
  return 4 * (words_.capacity() + word_offsets_.capacity() + landmarks_of_word_.capacity() +
              view_offsets_.capacity() + views_of_landmark_.capacity() + norm_.capacity()) +
         angles_.capacity() + sizeof(ViewPose) * poses_.capacity() +
         sizeof(Rigid3) * local_from_anchor_.capacity();
}

}  // namespace panofix
