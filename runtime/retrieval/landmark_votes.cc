#include "runtime/retrieval/landmark_votes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "common/features/matcher.h"
#include "common/geometry/attitude.h"
#include "common/map/local_frame.h"

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

LandmarkVotes::LandmarkVotes(std::shared_ptr<const MapBundle> bundle, const VoteOptions& options)
    : bundle_(std::move(bundle)), options_(options) {
  const std::size_t n = bundle_->num_landmarks();
  local_ = LocalFrame::At(bundle_->panoramas().front());
  points_.resize(n), size_m_.resize(n), angle_deg_.resize(n);
  std::vector<std::uint32_t> word_of(n);
  tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
    const auto id = static_cast<std::uint32_t>(i);
    const MapLandmark landmark = bundle_->Landmark(id);
    std::uint8_t descriptor[kDescriptorSize];
    bundle_->Descriptor(id, descriptor);
    word_of[i] = bundle_->vocabulary().sift.Quantize(descriptor);
    points_[i] =
        (local_.LocalFromPano(bundle_->panoramas()[landmark.panorama_idx]) * landmark.point_in_pano)
            .cast<float>();
    size_m_[i] = static_cast<float>(landmark.size_m);
    angle_deg_[i] = static_cast<float>(landmark.angle_deg);
  });
  Invert(word_of, bundle_->vocabulary().sift.num_words, &word_offsets_, &landmarks_of_word_);
  std::vector<std::uint32_t> landmark_of, view_of;
  for (std::uint32_t v = 0; v < bundle_->views().size(); ++v) {
    const MapBundle::LandmarkList list = bundle_->LandmarksOf(v);
    for (std::size_t i = 0; i < list.size(); ++i)
      landmark_of.push_back(list[i]), view_of.push_back(v);
    norm_.push_back(1 / std::sqrt(50.0F + static_cast<float>(list.size())));
    const MapView& view = bundle_->views()[v];
    const Rigid3 local_from_pano = local_.LocalFromPano(bundle_->panoramas()[view.panorama_idx]);
    const Eigen::Matrix3d local_from_cam =
        local_from_pano.rotation * EnuFromBody({view.yaw_deg, view.pitch_deg, 0}) * BodyFromCam();
    const Eigen::Vector3d centre =
        local_from_pano * bundle_->stations()[view.station_idx].position_in_pano;
    poses_.push_back({local_from_cam.transpose().cast<float>(), centre.cast<float>()});
  }
  std::vector<std::uint32_t> entries;
  Invert(landmark_of, n, &view_offsets_, &entries);
  for (const std::uint32_t entry : entries) views_of_landmark_.push_back(view_of[entry]);
}

void LandmarkVotes::VoteFor(const Keypoint& keypoint, const Eigen::Vector2d& bearing,
                            double focal_px, std::uint32_t landmark_id, float weight,
                            const std::vector<char>& wanted, std::vector<Vote>* votes) const {
  for (std::uint32_t i = view_offsets_[landmark_id]; i < view_offsets_[landmark_id + 1]; ++i) {
    const std::uint32_t view = views_of_landmark_[i];
    if (!wanted.empty() && wanted[view] == 0) continue;
    const ViewPose& pose = poses_[view];
    const Eigen::Vector3f x = pose.cam_from_map * (points_[landmark_id] - pose.centre);
    if (x.z() < 0.3F) continue;
    const double across_deg =
        (std::atan(bearing.x()) - std::atan2(double{x.x()}, double{x.z()})) / kRadPerDeg;
    const double up_deg =
        (std::atan(bearing.y()) - std::atan2(double{x.y()}, double{x.z()})) / kRadPerDeg;
    const double ratio =
        double{keypoint.size_px} * double{x.norm()} / (double{size_m_[landmark_id]} * focal_px);
    if (std::abs(across_deg) > options_.max_across_deg || std::abs(up_deg) > options_.max_up_deg ||
        ratio > options_.max_size_ratio || ratio * options_.max_size_ratio < 1) {
      continue;
    }
    votes->push_back({view, static_cast<std::int32_t>(std::floor(across_deg / options_.bin_deg)),
                      weight * norm_[view]});
  }
}

template <typename Visit>
void LandmarkVotes::ForEachAlike(const FeatureSet& sift, std::size_t keypoint,
                                 const Visit& visit) const {
  const double limit_sq = options_.max_descriptor_distance * options_.max_descriptor_distance;
  const double sigma = options_.descriptor_sigma;
  const std::uint8_t* descriptor = sift.descriptor(keypoint).data();
  std::vector<std::uint32_t> words;
  bundle_->vocabulary().sift.QuantizeSoft(descriptor, options_.num_words, &words);
  std::uint8_t other[kDescriptorSize];
  for (const std::uint32_t word : words) {
    for (std::uint32_t i = word_offsets_[word]; i < word_offsets_[word + 1]; ++i) {
      const std::uint32_t id = landmarks_of_word_[i];
      if (std::abs(AngleDifferenceDeg(double{sift.keypoints[keypoint].angle_deg},
                                      double{angle_deg_[id]})) > options_.max_turn_deg) {
        continue;
      }
      bundle_->Descriptor(id, other);
      const int distance_sq = DescriptorDistanceSq(descriptor, other);
      if (distance_sq <= limit_sq)
        visit(id, static_cast<float>(std::exp(-distance_sq / (2 * sigma * sigma))));
    }
  }
}

std::vector<float> LandmarkVotes::Count(std::vector<std::vector<Vote>> votes) const {
  const int half = static_cast<int>(std::ceil(options_.max_across_deg / options_.bin_deg));
  const auto num_bins = static_cast<std::size_t>(2 * half + 1);
  std::vector<float> bins(bundle_->views().size() * num_bins, 0);
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
  std::vector<float> scores(bundle_->views().size(), 0);
  for (std::size_t v = 0; v < scores.size(); ++v) {
    for (std::size_t b = 0; b + 1 < num_bins; ++b)
      scores[v] = std::max(scores[v], bins[v * num_bins + b] + bins[v * num_bins + b + 1]);
  }
  return scores;
}

std::vector<float> LandmarkVotes::Score(const FeatureSet& sift,
                                        std::span<const Eigen::Vector2d> bearings,
                                        const Camera& camera,
                                        const std::vector<char>& wanted) const {
  std::vector<std::vector<Vote>> votes(sift.size());
  tbb::parallel_for(std::size_t{0}, sift.size(), [&](std::size_t k) {
    ForEachAlike(sift, k, [&](std::uint32_t id, float weight) {
      VoteFor(sift.keypoints[k], bearings[k], camera.fx_px, id, weight, wanted, &votes[k]);
    });
  });
  return Count(std::move(votes));
}

}  // namespace panofix
