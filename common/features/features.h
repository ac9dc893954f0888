#pragma once
// Local features of a grey image: keypoints and byte descriptors, the same offline and online.

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/image/gray_image.h"

namespace panofix {

inline constexpr int kDescriptorSize = 128;
// Diameters of the smallest regions that are found, at full and at half size.
inline constexpr double kSmallestRegion_px = 2.0, kSmallestCoarseRegion_px = 2 * kSmallestRegion_px;

// A keypoint in pixels of the image it was found in; integer coordinates are pixel centres.
struct Keypoint {
  float x_px = 0, y_px = 0;
  float size_px = 0;    // diameter of the described region
  float angle_deg = 0;  // OpenCV's convention; 0 for upright regions
  float response = 0;
};

// N keypoints and their N x 128 byte descriptors, row i belonging to keypoint i.
struct FeatureSet {
  std::vector<Keypoint> keypoints;
  std::vector<std::uint8_t> descriptors;
  [[nodiscard]] std::size_t size() const { return keypoints.size(); }
  [[nodiscard]] std::span<const std::uint8_t> descriptor(std::size_t i) const {
    return {descriptors.data() + i * kDescriptorSize, kDescriptorSize};
  }
};

// What is done to an image before features are looked for.
enum class Equalization {
  kNone,
  kGlobal,  // histogram equalisation, the paper's
  kClahe,   // contrast limited and adaptive: holds where sun and shadow share a picture
};
[[nodiscard]] const char* EqualizationName(Equalization equalization);
[[nodiscard]] Result<Equalization> ParseEqualization(const std::string& name);

// The part of a bundle's preprocessing contract that decides what a feature is. A bundle is matched
// with the options it was built with, so they travel in its manifest.
struct FeatureOptions {
  Equalization equalization = Equalization::kClahe;
  double clahe_clip_limit = 2.5;          // kClahe only
  int clahe_tiles = 8;                    // tiles a side, kClahe only
  int max_sift = 2000;                    // strongest kept an image; time and bytes grow with it
  double sift_contrast_threshold = 0.03;  // lower finds more and weaker keypoints
  int max_mser = 400;                     // largest-margin regions kept an image; words only
  bool root_sift = true;  // Hellinger kernel (Arandjelovic and Zisserman, CVPR 2012)
  // Throws std::invalid_argument naming field, value and rule.
  void Check() const;
};

// The equalised image that features are extracted from.
[[nodiscard]] GrayImage Preprocess(const GrayImage& image, const FeatureOptions& options);

// SIFT (Lowe, IJCV 2004; OpenCV's detector, whose upsampling shifts keypoints by a quarter pixel:
// undone here), strongest first. Deterministic. `image` is preprocessed.
[[nodiscard]] FeatureSet ExtractSift(const GrayImage& image, const FeatureOptions& options);

// SIFT of the image at half its size: what is below `kSmallestCoarseRegion_px` is left out, at a
// quarter of the cost. Keypoints in pixels of `image`.
[[nodiscard]] FeatureSet ExtractCoarseSift(const GrayImage& image, const FeatureOptions& options);

// Maximally stable extremal regions (Matas et al., BMVC 2002), each described by an upright SIFT
// descriptor of its ellipse's size. `image` is preprocessed.
[[nodiscard]] FeatureSet ExtractMser(const GrayImage& image, const FeatureOptions& options);

}  // namespace panofix
