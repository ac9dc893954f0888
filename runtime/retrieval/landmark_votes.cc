#include "runtime/retrieval/landmark_votes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "common/features/matcher.h"
#include "common/geometry/attitude.h"

namespace panofix {

// One keypoint's vote for a view, at a turn of the camera against it.
struct Vote {
  std::uint32_t view = 0;
  std::int32_t bin = 0;
  float weight = 0;
};

namespace {

// Rows by key: offsets and values, values in ascending order of their number.
void Invert(const std::vector<std::uint32_t>& key_of, std::size_t num_keys,
            std::vector<std::uint32_t>* offsets, std::vector<std::uint32_t>* values) {
  offsets->assign(num_keys + 1, 0);
  for (const std::uint32_t key : key_of) ++(*offsets)[key + 1];
  for (std::size_t k = 0; k < num_keys; ++k) (*offsets)[k + 1] += (*offsets)[k];
  values->resize(key_of.size());
  std::vector<std::uint32_t> next(offsets->begin(), offsets->end() - 1);
  for (std::uint32_t i = 0; i < key_of.size(); ++i) (*values)[next[key_of[i]]++] = i;
}

}  // namespace

Voters::Voters(const Vocabulary& vocabulary, const FeatureSet& sift_features,
               std::span<const Eigen::Vector2d> keypoint_bearings, const Camera& frame_camera,
               const VoteOptions& options)
    : sift(sift_features),
      bearings(keypoint_bearings),
      camera(frame_camera),
      words(sift_features.size()) {
  tbb::parallel_for(std::size_t{0}, words.size(), [&](std::size_t k) {
    vocabulary.sift.QuantizeSoft(sift.descriptor(k).data(), options.num_words, &words[k]);
  });
}

std::vector<std::uint32_t> WordsOfLandmarks(const MapBundle& bundle, std::size_t tile_idx) {
  const MapTile& tile = bundle.tiles().Get(tile_idx);
  std::vector<std::uint32_t> words(tile.num_landmarks());
  tbb::parallel_for(std::size_t{0}, words.size(), [&](std::size_t i) {
    std::uint8_t descriptor[kDescriptorSize];
    tile.Descriptor(i, descriptor);
    words[i] = bundle.vocabulary().sift.Quantize(descriptor);
  });
  return words;
}

TileVotes::TileVotes(const MapBundle& bundle, std::size_t tile_idx,
                     const std::vector<std::uint32_t>& words, const LocalFrame& local,
                     const VoteOptions& options)
    : bundle_(bundle), tile_(tile_idx), options_(options) {
  const MapTile& tile = bundle_.tiles().Get(tile_);
  // A tile that was lost since its words were taken has none.
  const std::size_t n = std::min(tile.num_landmarks(), words.size());
  points_.resize(n), size_m_.resize(n), angle_deg_.resize(n);
  std::uint32_t anchor = ~0U;  // landmarks of one anchor follow each other
  Rigid3 local_from_anchor;
  for (std::size_t i = 0; i < n; ++i) {
    const MapLandmark landmark = tile.Landmark(i);
    if (landmark.panorama_idx != anchor) {
      anchor = landmark.panorama_idx;
      local_from_anchor = local.LocalFromPano(bundle_.panoramas()[anchor]);
    }
    points_[i] = (local_from_anchor * landmark.point_in_pano).cast<float>();
    size_m_[i] = static_cast<float>(landmark.size_m);
    angle_deg_[i] = static_cast<float>(landmark.angle_deg);
  }
  words_.assign(words.begin(), words.begin() + static_cast<std::ptrdiff_t>(n));
  std::sort(words_.begin(), words_.end());
  words_.erase(std::unique(words_.begin(), words_.end()), words_.end());
  std::vector<std::uint32_t> row_of(n);
  for (std::size_t i = 0; i < n; ++i) {
    row_of[i] = static_cast<std::uint32_t>(
        std::lower_bound(words_.begin(), words_.end(), words[i]) - words_.begin());
  }
  Invert(row_of, words_.size(), &word_offsets_, &landmarks_of_word_);
  std::vector<std::uint32_t> landmark_of, view_of;
  for (std::uint32_t slot = 0; slot < tile.num_views(); ++slot) {
    const std::span<const std::uint32_t> list = tile.LandmarksOf(slot);
    landmark_of.insert(landmark_of.end(), list.begin(), list.end());
    view_of.resize(landmark_of.size(), slot);
    norm_.push_back(1 / std::sqrt(50.0F + static_cast<float>(list.size())));
    AddView(bundle_.ViewsOfTile(tile_)[slot], local);
  }
  std::vector<std::uint32_t> entries;
  Invert(landmark_of, n, &view_offsets_, &entries);
  views_of_landmark_.reserve(entries.size());
  for (const std::uint32_t entry : entries) views_of_landmark_.push_back(view_of[entry]);
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

void TileVotes::VoteFor(const Voters& voters, std::size_t keypoint_idx, std::uint32_t landmark,
                        float weight, const std::vector<char>& wanted,
                        std::vector<Vote>* votes) const {
  const Keypoint& keypoint = voters.sift.keypoints[keypoint_idx];
  const Eigen::Vector2d& bearing = voters.bearings[keypoint_idx];
  const std::vector<std::uint32_t>& views = bundle_.ViewsOfTile(tile_);
  for (std::uint32_t i = view_offsets_[landmark]; i < view_offsets_[landmark + 1]; ++i) {
    const std::uint32_t view = views_of_landmark_[i];
    if (!wanted.empty() && wanted[views[view]] == 0) continue;
    const ViewPose& pose = poses_[view];
    const Eigen::Vector3f x = pose.cam_from_map * (points_[landmark] - pose.centre);
    if (x.z() < 0.3F) continue;
    const double across_deg =
        (std::atan(bearing.x()) - std::atan2(double{x.x()}, double{x.z()})) / kRadPerDeg;
    const double up_deg =
        (std::atan(bearing.y()) - std::atan2(double{x.y()}, double{x.z()})) / kRadPerDeg;
    const double ratio = double{keypoint.size_px} * double{x.norm()} /
                         (double{size_m_[landmark]} * voters.camera.fx_px);
    if (std::abs(across_deg) > options_.max_across_deg || std::abs(up_deg) > options_.max_up_deg ||
        ratio > options_.max_size_ratio || ratio * options_.max_size_ratio < 1) {
      continue;
    }
    votes->push_back({view, static_cast<std::int32_t>(std::floor(across_deg / options_.bin_deg)),
                      weight * norm_[view]});
  }
}

template <typename Visit>
void TileVotes::ForEachAlike(const Voters& voters, std::size_t keypoint, const Visit& visit) const {
  const double limit_sq = options_.max_descriptor_distance * options_.max_descriptor_distance;
  const double sigma = options_.descriptor_sigma;
  const std::uint8_t* descriptor = voters.sift.descriptor(keypoint).data();
  const double angle_deg = double{voters.sift.keypoints[keypoint].angle_deg};
  const std::uint32_t first_id = bundle_.first_landmark(tile_);
  std::uint8_t other[kDescriptorSize];
  for (const std::uint32_t word : voters.words[keypoint]) {
    const auto found = std::lower_bound(words_.begin(), words_.end(), word);
    if (found == words_.end() || *found != word) continue;
    const auto row = static_cast<std::size_t>(found - words_.begin());
    for (std::uint32_t i = word_offsets_[row]; i < word_offsets_[row + 1]; ++i) {
      const std::uint32_t landmark = landmarks_of_word_[i];
      if (std::abs(AngleDifferenceDeg(angle_deg, double{angle_deg_[landmark]})) >
          options_.max_turn_deg) {
        continue;
      }
      bundle_.Descriptor(first_id + landmark, other);
      const int distance_sq = DescriptorDistanceSq(descriptor, other);
      if (distance_sq <= limit_sq)
        visit(landmark, static_cast<float>(std::exp(-distance_sq / (2 * sigma * sigma))));
    }
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
  std::vector<std::vector<Vote>> votes(voters.sift.size());
  tbb::parallel_for(std::size_t{0}, voters.sift.size(), [&](std::size_t k) {
    ForEachAlike(voters, k, [&](std::uint32_t landmark, float weight) {
      VoteFor(voters, k, landmark, weight, wanted, &votes[k]);
    });
  });
  const std::vector<float> of_slot = Count(std::move(votes));
  const std::vector<std::uint32_t>& views = bundle_.ViewsOfTile(tile_);
  for (std::size_t slot = 0; slot < of_slot.size(); ++slot) (*scores)[views[slot]] = of_slot[slot];
}

std::size_t TileVotes::num_bytes() const {
  return 4 * (words_.capacity() + word_offsets_.capacity() + landmarks_of_word_.capacity() +
              view_offsets_.capacity() + views_of_landmark_.capacity() + 3 * points_.capacity() +
              size_m_.capacity() + angle_deg_.capacity() + norm_.capacity()) +
         sizeof(ViewPose) * poses_.capacity();
}

}  // namespace panofix
