#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <stdexcept>

#include "common/features/features.h"
#include "tests/common/features/synthetic_image.h"

namespace panofix {
namespace {

TEST(Preprocess, NoneLeavesTheImageAlone) {
  FeatureOptions options;
  options.equalization = Equalization::kNone;
  const GrayImage image = BusyImage(160, 120, 1);
  EXPECT_EQ(Preprocess(image, options).pixels, image.pixels);
}

// Histogram equalisation by its definition: grey v becomes the share of pixels up to v, the darkest
// grey taken out.
TEST(Preprocess, GlobalFollowsTheDefinition) {
  FeatureOptions options;
  options.equalization = Equalization::kGlobal;
  const GrayImage image = BusyImage(160, 120, 2);
  std::array<int, 256> cumulative{};
  for (const std::uint8_t v : image.pixels) ++cumulative[v];
  for (std::size_t v = 1; v < 256; ++v) cumulative[v] += cumulative[v - 1];
  const int total = cumulative[255];
  const int darkest =
      *std::find_if(cumulative.begin(), cumulative.end(), [](int c) { return c > 0; });
  const GrayImage equal = Preprocess(image, options);
  ASSERT_EQ(equal.pixels.size(), image.pixels.size());
  for (std::size_t i = 0; i < image.pixels.size(); ++i) {
    const double expected = 255.0 * (cumulative[image.pixels[i]] - darkest) / (total - darkest);
    ASSERT_NEAR(static_cast<double>(equal.pixels[i]), expected, 1.0);
  }
}

double Contrast(const GrayImage& image, int x0, int x1) {
  double sum = 0, sum_sq = 0;
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = x0; x < x1; ++x) {
      const double v = image.pixels[static_cast<std::size_t>(y * image.width_px + x)];
      sum += v, sum_sq += v * v;
    }
  }
  const double n = static_cast<double>(image.height_px) * (x1 - x0);
  return std::sqrt(sum_sq / n - sum * sum / n / n);
}

TEST(Preprocess, ClaheLiftsTheShadow) {
  GrayImage image = BusyImage(320, 240, 3);
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 160; ++x) image.pixels[static_cast<std::size_t>(y * 320 + x)] /= 8;
  }
  const GrayImage equal = Preprocess(image, {});
  EXPECT_GT(Contrast(equal, 20, 140), 2 * Contrast(image, 20, 140));
}

TEST(Preprocess, AnEmptyImageStaysEmpty) {
  for (const auto e : {Equalization::kNone, Equalization::kGlobal, Equalization::kClahe}) {
    FeatureOptions options;
    options.equalization = e;
    EXPECT_TRUE(Preprocess({}, options).empty());
  }
}

TEST(Equalization, NamesRoundTrip) {
  for (const auto e : {Equalization::kNone, Equalization::kGlobal, Equalization::kClahe}) {
    const auto parsed = ParseEqualization(EqualizationName(e));
    ASSERT_TRUE(parsed.ok());
    EXPECT_EQ(*parsed, e);
  }
  for (const char* name : {"", "Clahe", "histogram"}) {
    EXPECT_EQ(ParseEqualization(name).status().code(), ErrorCode::kInvalidArgument);
  }
}

TEST(FeatureOptions, CheckNamesTheField) {
  EXPECT_NO_THROW(FeatureOptions().Check());
  const auto message = [](const std::function<void(FeatureOptions*)>& change) -> std::string {
    FeatureOptions options;
    change(&options);
    try {
      options.Check();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "nothing thrown";
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const auto names = [](const std::string& text, const char* field) {
    EXPECT_EQ(text.rfind(field, 0), 0U) << text;
  };
  names(message([](FeatureOptions* o) { o->clahe_clip_limit = 0; }), "clahe_clip_limit");
  names(message([](FeatureOptions* o) { o->clahe_clip_limit = kNan; }), "clahe_clip_limit");
  names(message([](FeatureOptions* o) { o->clahe_tiles = 0; }), "clahe_tiles");
  names(message([](FeatureOptions* o) { o->max_sift = 49; }), "max_sift");
  names(message([](FeatureOptions* o) { o->sift_contrast_threshold = -0.1; }), "sift_contrast");
  names(message([](FeatureOptions* o) { o->sift_contrast_threshold = kNan; }), "sift_contrast");
  names(message([](FeatureOptions* o) { o->max_mser = -1; }), "max_mser");
}

}  // namespace
}  // namespace panofix
