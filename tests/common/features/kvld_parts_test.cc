// The parts kVLD is made of, against closed forms and brute force.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>

#include "common/base/rng.h"
#include "common/features/gradient_pyramid.h"
#include "common/features/match_neighbours.h"
#include "common/features/virtual_line.h"
#include "tests/common/features/synthetic_image.h"

namespace panofix {
namespace {

constexpr double kTurnTolerance = 1;  // 1/65536 of a circle: rounding
// Grey levels: rounding to half a unit of 1/128, and the root's 1.1e-4 of at most 361.
constexpr double kNormTolerance = 0.5 / 128 + 0.04;
// A relative histogram's entries: norms are rounded, and single pixels lie on the edge of two bins.
constexpr double kHistogramTolerance = 2e-3;
constexpr double kSameLine = 0.02;  // of lines that see the same pixels, turned by 90 degrees

struct Gradient {
  double x = 0, y = 0;
};

Gradient GradientOf(GradientPixel pixel) {
  const double angle = GradientTurn(pixel) * 2 * std::numbers::pi / 65536;
  const double norm = GradientNorm(pixel) * kGradientNormUnit;
  return {norm * std::cos(angle), norm * std::sin(angle)};
}

GradientPixel At(const GradientLevel& level, int x, int y) {
  return level.pixels[static_cast<std::size_t>(y * level.width_px + x)];
}

// Mean grey over the square [x, x + 1) x [y, y + 1) of a level, pixel areas weighed exactly.
double BoxMean(const GrayImage& image, int x, int y, double ratio) {
  double sum = 0;
  const auto overlap = [&](int source, int at) {
    return std::max(0.0,
                    std::min(source + 1.0, (at + 1) * ratio) - std::max(source * 1.0, at * ratio));
  };
  for (int v = static_cast<int>(y * ratio); v < std::min<double>(image.height_px, (y + 1) * ratio);
       ++v) {
    for (int u = static_cast<int>(x * ratio); u < std::min<double>(image.width_px, (x + 1) * ratio);
         ++u) {
      sum += overlap(u, x) * overlap(v, y) *
             image.pixels[static_cast<std::size_t>(v * image.width_px + u)];
    }
  }
  return sum / (ratio * ratio);
}

TEST(GradientPyramid, RampsPointWhereTheyRise) {
  for (const auto& [dx, dy] :
       {std::pair{3, 0}, {0, 3}, {-3, 0}, {0, -3}, {2, 1}, {-1, -2}, {-2, 1}}) {
    GrayImage image{21, 17, {}};
    for (int y = 0; y < image.height_px; ++y) {
      for (int x = 0; x < image.width_px; ++x) {
        image.pixels.push_back(static_cast<std::uint8_t>(127 + dx * (x - 10) + dy * (y - 8)));
      }
    }
    const GradientPyramid pyramid(image);
    const GradientPixel pixel = At(pyramid.impl().levels[0], 10, 8);
    const double turn = std::atan2(dy, dx) * 65536 / (2 * std::numbers::pi);
    EXPECT_NEAR(std::remainder(GradientTurn(pixel) - turn, 65536), 0, kTurnTolerance);
    EXPECT_NEAR(GradientNorm(pixel) * kGradientNormUnit, 2 * std::hypot(dx, dy), kNormTolerance);
  }
}

TEST(GradientPyramid, LevelsAreCentralDifferencesOfBoxMeans) {
  const GrayImage image = BusyImage(61, 47, 3);
  const GradientPyramid pyramid(image);
  ASSERT_GE(pyramid.impl().levels.size(), 5U);
  for (std::size_t i = 0; i < 5; ++i) {
    const GradientLevel& level = pyramid.impl().levels[i];
    EXPECT_NEAR(level.ratio, std::pow(std::numbers::sqrt2, i), 1e-12);
    EXPECT_EQ(level.width_px, static_cast<int>(61 / level.ratio + 1e-9));
    EXPECT_EQ(level.height_px, static_cast<int>(47 / level.ratio + 1e-9));
    for (int y = 1; y + 1 < level.height_px; ++y) {
      for (int x = 1; x + 1 < level.width_px; ++x) {
        const auto mean = [&](int u, int v) { return BoxMean(image, u, v, level.ratio); };
        const Gradient g = GradientOf(At(level, x, y));
        EXPECT_NEAR(g.x, mean(x + 1, y) - mean(x - 1, y), kNormTolerance);
        EXPECT_NEAR(g.y, mean(x, y + 1) - mean(x, y - 1), kNormTolerance);
      }
    }
  }
}

TEST(GradientPyramid, SmallImagesHaveNoLevels) {
  for (const auto& [width, height] : {std::pair{1, 1}, {2, 100}, {100, 2}}) {
    const GradientPyramid pyramid(BusyImage(width, height, 1));
    EXPECT_TRUE(pyramid.impl().levels.empty());
  }
  EXPECT_EQ(GradientPyramid(BusyImage(3, 3, 1)).impl().levels.size(), 1U);
}

TEST(GradientPyramid, PixelsThatAreNotTheImagesThrow) {
  EXPECT_THROW(GradientPyramid(GrayImage{}), std::invalid_argument);
  EXPECT_THROW(GradientPyramid(GrayImage{4, 4, std::vector<std::uint8_t>(15)}),
               std::invalid_argument);
  EXPECT_THROW(GradientPyramid(GrayImage{-4, -4, std::vector<std::uint8_t>(16)}),
               std::invalid_argument);
}

// The paper's descriptor in doubles, from the pixels themselves; for lines short enough for level
// 0.
LineDescriptor SlowLine(const GrayImage& image, double x0, double y0, double x1, double y1) {
  const KvldOptions options;
  LineDescriptor line;
  const double length = std::hypot(x1 - x0, y1 - y0);
  const double radius = std::max(2.0, length / (options.num_samples + 1));
  const double line_angle = std::atan2(y1 - y0, x1 - x0), circle = 2 * std::numbers::pi;
  std::vector<double> histogram(80), weights(10);
  const auto grey = [&](int x, int y) {
    return static_cast<double>(image.pixels.at(static_cast<std::size_t>(y * image.width_px + x)));
  };
  for (int i = 0; i < options.num_samples; ++i) {
    const double t = (i + 1.0) / (options.num_samples + 1);
    const double cx = x0 + t * (x1 - x0), cy = y0 + t * (y1 - y0);
    std::vector<double> bins(24);
    for (int y = 1; y + 1 < image.height_px; ++y) {
      for (int x = 1; x + 1 < image.width_px; ++x) {
        const double d2 = (x - cx) * (x - cx) + (y - cy) * (y - cy);
        if (d2 > radius * radius) continue;
        const double gx = grey(x + 1, y) - grey(x - 1, y), gy = grey(x, y + 1) - grey(x, y - 1);
        const double weight = std::hypot(gx, gy) * std::exp(-d2 / (4.5 * radius * radius));
        const double turn = std::remainder(std::atan2(gy, gx) - line_angle, circle) / circle + 1;
        bins[static_cast<std::size_t>(std::lround(turn * 24)) % 24] += weight;
        histogram[static_cast<std::size_t>(8 * i + std::lround(turn * 8) % 8)] += weight;
      }
    }
    const auto at = static_cast<std::size_t>(i);
    for (std::size_t bin = 0; bin < 24; ++bin) {
      const double excess = bins[bin] - bins[(bin + 12) % 24];
      if (excess > weights[at])
        weights[at] = excess, line.orientation_bin[at] = static_cast<int>(bin);
    }
  }
  double sum = 0;
  for (const double v : histogram) sum += v;
  for (const double w : weights) line.contrast += w / length;
  for (std::size_t i = 0; i < 80; ++i) line.histogram[i] = static_cast<float>(histogram[i] / sum);
  for (std::size_t i = 0; i < 10; ++i) {
    line.weight[i] = static_cast<float>(weights[i] / (line.contrast * length));
  }
  return line;
}

TEST(VirtualLine, IsWhatDoublesGive) {
  const GrayImage image = BusyImage(160, 120, 5);
  const GradientPyramid pyramid(image);
  Rng rng(1, "tests/virtual_line");
  for (int trial = 0; trial < 40; ++trial) {
    // Ends outside the image too.
    const double x = rng.Uniform(-10, 170), y = rng.Uniform(-10, 130);
    const double angle = rng.Uniform(0, 7), length = rng.Uniform(12, 75);
    const double x1 = x + length * std::cos(angle), y1 = y + length * std::sin(angle);
    const LineDescriptor fast = DescribeLine(pyramid, x, y, x1, y1, {});
    const LineDescriptor slow = SlowLine(image, x, y, x1, y1);
    ASSERT_EQ(fast.contrast > 0, slow.contrast > 0);
    if (slow.contrast == 0) continue;
    EXPECT_NEAR(fast.contrast / slow.contrast, 1, 1e-2);
    for (std::size_t i = 0; i < 80; ++i) {
      EXPECT_NEAR(fast.histogram[i], slow.histogram[i], kHistogramTolerance);
    }
    EXPECT_LT(LineDistance(fast, slow, {}), kSameLine);
  }
}

TEST(VirtualLine, TurnsWithTheImage) {
  const GrayImage image = BusyImage(200, 200, 6);
  GrayImage turned = image;  // clockwise: (x, y) goes to (199 - y, x)
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 200; ++x) {
      turned.pixels[static_cast<std::size_t>(x * 200 + 199 - y)] =
          image.pixels[static_cast<std::size_t>(y * 200 + x)];
    }
  }
  const GradientPyramid a(image), b(turned);
  for (const double length : {20.0, 60.0}) {
    const LineDescriptor line = DescribeLine(a, 60, 70, 60 + length, 80, {});
    const LineDescriptor same = DescribeLine(b, 129, 60, 119, 60 + length, {});
    const LineDescriptor other = DescribeLine(b, 60, 70, 60 + length, 80, {});
    EXPECT_LT(LineDistance(line, same, {}), kSameLine);
    EXPECT_GT(LineDistance(line, other, {}), KvldOptions{}.descriptor_threshold);
  }
}

TEST(VirtualLine, NeedsContrastAndNotTooMuch) {
  const GradientPyramid flat(GrayImage{64, 64, std::vector<std::uint8_t>(64 * 64, 77)});
  const GradientPyramid busy(BusyImage(64, 64, 2));
  const LineDescriptor none = DescribeLine(flat, 10, 10, 50, 40, {});
  const LineDescriptor some = DescribeLine(busy, 10, 10, 50, 40, {});
  EXPECT_EQ(none.contrast, 0);
  EXPECT_TRUE(std::isinf(LineDistance(none, none, {})));
  EXPECT_TRUE(std::isinf(LineDistance(some, none, {})));
  EXPECT_EQ(LineDistance(some, some, {}), 0);
  KvldOptions strict;
  strict.max_contrast = some.contrast / 2;
  EXPECT_TRUE(std::isinf(LineDistance(some, some, strict)));
}

TEST(VirtualLine, FarAwayTooLongAndOfNoLengthHaveNoContrast) {
  const GradientPyramid busy(BusyImage(64, 64, 2)), thin(BusyImage(640, 3, 2)),
      tiny(BusyImage(2, 2, 2));
  EXPECT_EQ(DescribeLine(busy, 1e30, -1e30, 1e30, 1e30, {}).contrast, 0);
  EXPECT_EQ(DescribeLine(busy, 5000, 5000, 5040, 5030, {}).contrast, 0);
  EXPECT_EQ(DescribeLine(busy, 9, 9, 9, 9, {}).contrast, 0);
  EXPECT_EQ(DescribeLine(thin, 0, 1, 639, 1, {}).contrast, 0);  // its one level is too fine
  EXPECT_EQ(DescribeLine(tiny, 0, 0, 1, 1, {}).contrast, 0);
}

PlacedMatch RandomMatch(Rng* rng) {
  return {{rng->Uniform(0, 300), rng->Uniform(0, 200)},
          {rng->Uniform(0, 500), rng->Uniform(0, 90)},
          std::polar(rng->Uniform(0.3, 3), rng->Uniform(0, 7))};
}

TEST(GeometricError, IsZeroUnderASimilarityAndRelativeBeside) {
  Rng rng(2, "tests/geometric_error");
  for (int trial = 0; trial < 20; ++trial) {
    const PlacedMatch a = RandomMatch(&rng);
    PlacedMatch b = RandomMatch(&rng);
    b.database_px = a.database_px + a.database_from_query * (b.query_px - a.query_px);
    EXPECT_NEAR(GeometricError(a, b), 0, 1e-12);
    EXPECT_NEAR(GeometricError(b, a), 0, 1e-12);
    // Both say the same, and the neighbour is a tenth farther away than they say.
    b.database_from_query = a.database_from_query;
    b.database_px += 0.1 * (b.database_px - a.database_px);
    EXPECT_NEAR(GeometricError(a, b), 0.1, 1e-12);
    // A quarter turn off: the chord of it.
    b.database_px = a.database_px +
                    std::complex<double>(0, 1) * a.database_from_query * (b.query_px - a.query_px);
    EXPECT_NEAR(GeometricError(a, b), std::numbers::sqrt2, 1e-12);
  }
}

TEST(MatchNeighbours, AreThoseOfAllPairs) {
  Rng rng(3, "tests/match_neighbours");
  std::vector<PlacedMatch> matches;
  for (int i = 0; i < 300; ++i) matches.push_back(RandomMatch(&rng));
  matches.push_back(matches[7]);                  // at the same place
  matches.push_back({{-40, 900}, {600, -1}, 1});  // outside both images
  for (const double range_px : {5.0, 40.0, 150.0, 5000.0}) {
    const MatchNeighbours neighbours(matches, {300, 200, range_px}, {500, 90, range_px / 2}, 10);
    for (std::size_t i = 0; i < matches.size(); ++i) {
      std::multiset<std::size_t> found, expected;
      neighbours.ForEach(static_cast<int>(i),
                         [&](int other) { found.insert(static_cast<std::size_t>(other)); });
      for (std::size_t j = 0; j < matches.size(); ++j) {
        const double query = std::abs(matches[i].query_px - matches[j].query_px);
        const double database = std::abs(matches[i].database_px - matches[j].database_px);
        if (query > 10 && database > 10 && (query < range_px || database < range_px / 2)) {
          expected.insert(j);
        }
      }
      ASSERT_EQ(found, expected);
    }
  }
}

}  // namespace
}  // namespace panofix
