#include "common/features/features.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "common/base/log.h"

namespace panofix {
namespace {

// OpenCV 4.6 doubles the image with cv::resize before its first octave and halves coordinates
// after, without the half-pixel shift of resize: found points lie 1/4 px right of and below the
// structure.
constexpr float kUpsamplingShift_px = 0.25F;

cv::Mat View(const GrayImage& image) {
  return {image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.pixels.data())};
}

// Float descriptor to bytes. RootSIFT has unit length; 512 keeps its largest entries below 256.
void Quantize(const float* values, bool root_sift, std::uint8_t* bytes) {
  float sum = 0;
  for (int i = 0; i < kDescriptorSize; ++i) sum += values[i];
  for (int i = 0; i < kDescriptorSize; ++i) {
    const float value = root_sift ? 512.0F * std::sqrt(values[i] / std::max(sum, 1.0F)) : values[i];
    bytes[i] = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
  }
}

FeatureSet ToFeatureSet(const std::vector<cv::KeyPoint>& found, const cv::Mat& described,
                        const FeatureOptions& options, float shift_px, int max_features) {
  // A total order, so that equal responses do not depend on the detector's threads.
  std::vector<int> order(found.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    const auto key = [&](int i) {
      const cv::KeyPoint& k = found[static_cast<std::size_t>(i)];
      return std::make_tuple(-k.response, k.pt.y, k.pt.x, k.size, k.angle);
    };
    return key(a) < key(b);
  });
  // OpenCV keeps all that equal the last response: a regular facade would exceed any limit.
  order.resize(std::min(order.size(), static_cast<std::size_t>(max_features)));
  FeatureSet set;
  set.keypoints.reserve(order.size());
  set.descriptors.resize(order.size() * kDescriptorSize);
  for (std::size_t row = 0; row < order.size(); ++row) {
    const cv::KeyPoint& k = found[static_cast<std::size_t>(order[row])];
    set.keypoints.push_back({k.pt.x - shift_px, k.pt.y - shift_px, k.size, k.angle, k.response});
    Quantize(described.ptr<float>(order[row]), options.root_sift,
             set.descriptors.data() + row * kDescriptorSize);
  }
  return set;
}

// The pyramid level at which a region of `size_px` is described, packed as OpenCV's SIFT packs it:
// without it a large region would be described pixel by pixel at full size.
int PackedOctave(float size_px) {
  constexpr float kBaseDiameter_px = 3.2F;  // 2 sigma of the first level
  const int octave =
      std::clamp(static_cast<int>(std::floor(std::log2(size_px / kBaseDiameter_px))), 0, 6);
  return octave | (1 << 8);
}

}  // namespace

const char* EqualizationName(Equalization equalization) {
  switch (equalization) {
    case Equalization::kNone:
      return "none";
    case Equalization::kGlobal:
      return "global";
    case Equalization::kClahe:
      return "clahe";
  }
  return "none";
}

Result<Equalization> ParseEqualization(const std::string& name) {
  for (const Equalization e : {Equalization::kNone, Equalization::kGlobal, Equalization::kClahe}) {
    if (name == EqualizationName(e)) return e;
  }
  return Status(ErrorCode::kInvalidArgument,
                "equalization '" + name + "'; use none, global or clahe");
}

void FeatureOptions::Check() const {
  const auto require = [](bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument(message);
  };
  require(clahe_clip_limit > 0 && clahe_clip_limit <= 100,
          Format("clahe_clip_limit = %g; must lie in (0, 100]", clahe_clip_limit));
  require(clahe_tiles >= 1 && clahe_tiles <= 64,
          Format("clahe_tiles = %d; must lie in 1..64", clahe_tiles));
  require(max_sift >= 50 && max_sift <= 50000,
          Format("max_sift = %d; must lie in 50..50000", max_sift));
  require(sift_contrast_threshold >= 0 && sift_contrast_threshold < 1,
          Format("sift_contrast_threshold = %g; must lie in [0, 1)", sift_contrast_threshold));
  require(max_mser >= 0 && max_mser <= 10000,
          Format("max_mser = %d; must lie in 0..10000", max_mser));
}

GrayImage Preprocess(const GrayImage& image, const FeatureOptions& options) {
  if (image.empty() || options.equalization == Equalization::kNone) return image;
  GrayImage result = image;
  cv::Mat target = View(result);
  if (options.equalization == Equalization::kGlobal) {
    cv::equalizeHist(View(image), target);
  } else {
    cv::createCLAHE(options.clahe_clip_limit, {options.clahe_tiles, options.clahe_tiles})
        ->apply(View(image), target);
  }
  return result;
}

FeatureSet ExtractSift(const GrayImage& image, const FeatureOptions& options) {
  if (image.empty()) return {};
  std::vector<cv::KeyPoint> found;
  cv::Mat described;
  cv::SIFT::create(options.max_sift, 3, options.sift_contrast_threshold)
      ->detectAndCompute(View(image), cv::noArray(), found, described);
  return ToFeatureSet(found, described, options, kUpsamplingShift_px, options.max_sift);
}

FeatureSet ExtractCoarseSift(const GrayImage& image, const FeatureOptions& options) {
  if (image.width_px < 2 || image.height_px < 2) return {};
  GrayImage half;
  half.width_px = image.width_px / 2, half.height_px = image.height_px / 2;
  half.pixels.resize(static_cast<std::size_t>(half.width_px) *
                     static_cast<std::size_t>(half.height_px));
  cv::Mat target = View(half);
  cv::resize(View(image), target, target.size(), 0, 0, cv::INTER_AREA);
  const float scale_x = static_cast<float>(image.width_px) / static_cast<float>(half.width_px);
  const float scale_y = static_cast<float>(image.height_px) / static_cast<float>(half.height_px);
  FeatureSet set = ExtractSift(half, options);
  for (Keypoint& k : set.keypoints) {
    k.x_px = scale_x * (k.x_px + 0.5F) - 0.5F;
    k.y_px = scale_y * (k.y_px + 0.5F) - 0.5F;
    k.size_px *= scale_x;
  }
  return set;
}

FeatureSet ExtractMser(const GrayImage& image, const FeatureOptions& options) {
  if (image.empty() || options.max_mser == 0) return {};
  const int area = image.width_px * image.height_px;
  std::vector<std::vector<cv::Point>> regions;
  std::vector<cv::Rect> boxes;
  cv::MSER::create(5, std::max(30, area / 16000), area / 20)
      ->detectRegions(View(image), regions, boxes);
  std::vector<cv::KeyPoint> found;
  for (const auto& region : regions) {
    // Second moments: the ellipse's mean diameter is 4 (det S)^(1/4).
    double sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
    for (const cv::Point& p : region) {
      sx += p.x, sy += p.y;
      sxx += double(p.x) * p.x, sxy += double(p.x) * p.y, syy += double(p.y) * p.y;
    }
    const double n = static_cast<double>(region.size()), mx = sx / n, my = sy / n;
    const double det = (sxx / n - mx * mx) * (syy / n - my * my) - std::pow(sxy / n - mx * my, 2);
    if (det <= 0.25) continue;  // a line: no region to describe
    const auto size_px = static_cast<float>(4.0 * std::pow(det, 0.25));
    found.emplace_back(static_cast<float>(mx), static_cast<float>(my), size_px, 0.0F,
                       static_cast<float>(n), PackedOctave(size_px));
  }
  // Large regions are the repeatable ones.
  std::sort(found.begin(), found.end(), [](const cv::KeyPoint& a, const cv::KeyPoint& b) {
    return std::make_tuple(-a.response, a.pt.y, a.pt.x) <
           std::make_tuple(-b.response, b.pt.y, b.pt.x);
  });
  if (found.size() > static_cast<std::size_t>(options.max_mser)) {
    found.resize(static_cast<std::size_t>(options.max_mser));
  }
  if (found.empty()) return {};
  cv::Mat described;
  cv::SIFT::create()->compute(View(image), found, described);
  return ToFeatureSet(found, described, options, 0.0F, options.max_mser);
}

}  // namespace panofix
