#include "builder/augment/view_painter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace panofix {
namespace {

constexpr int kCoarse_px = 8, kFine_px = 2;
// Checked at a block's centre, where the error of a bilinear fit to a smooth map is largest; half
// of what is promised, for the part that is not quadratic.
constexpr double kMaxBend_px = 0.05;
// A sample stands for so many pixels of its pyramid level in a row without visible aliasing.
constexpr float kReach_px = 1.3F;
constexpr int kMaxTaps = 4;

// Continuous full-size panorama coordinates, pixel edges at whole numbers; x may leave [0, width)
// by what keeps a block in one piece.
struct PanoramaPx {
  double x = 0, y = 0;
};

// How to sample around a block: `taps` in a row along the direction in which the panorama is
// shrunk most.
struct Footprint {
  const PyramidLevel* level = nullptr;
  int taps = 1;
  float x_step = 0, y_step = 0;  // level pixels from tap to tap
};

class Painter {
 public:
  Painter(SurfaceCaster& caster, const Camera& camera, std::vector<SurfaceLabel>& labels)
      : caster_(caster),
        width_(camera.width_px),
        height_(camera.height_px),
        grid_width_((width_ + kCoarse_px) / kFine_px + 1),
        grid_(static_cast<std::size_t>(grid_width_) *
                  static_cast<std::size_t>((height_ + kCoarse_px) / kFine_px + 1),
              kNotCast),
        labels_(labels),
        image_{width_, height_, {}} {
    image_.pixels.assign(labels.size(), 0);
  }

  // Paints pixels [x, x + size) x [y, y + size).
  void PaintBlock(int x, int y, int size) {
    if (x >= width_ || y >= height_) return;
    if (size == kFine_px) return PaintFine(x, y);
    const SurfaceLabel label = LabelAt(x, y);
    const int half = size / 2;
    const bool is_one = LabelAt(x + size, y) == label && LabelAt(x, y + size) == label &&
                        LabelAt(x + size, y + size) == label &&
                        LabelAt(x + half, y + half) == label;
    if (is_one && (label == 0 || PaintSmooth(x, y, size, label))) return;
    for (const int part : {0, 1, 2, 3}) {
      PaintBlock(x + part % 2 * half, y + part / 2 * half, half);
    }
  }
  GrayImage TakeImage() { return std::move(image_); }

 private:
  static constexpr int kNotCast = -1;

  SurfaceLabel LabelAt(int x, int y) {
    int& label =
        grid_[static_cast<std::size_t>(y / kFine_px) * static_cast<std::size_t>(grid_width_) +
              static_cast<std::size_t>(x / kFine_px)];
    if (label == kNotCast) label = caster_.Cast(x, y);
    return static_cast<SurfaceLabel>(label);
  }
  const RenderSource::Impl& SourceOf(SurfaceLabel label) const {
    const int source_idx = caster_.surfaces()[label - std::size_t{1}].source_idx;
    return *caster_.sources()[static_cast<std::size_t>(source_idx)].source;
  }

  PanoramaPx Trace(double x, double y, SurfaceLabel label) const;
  PanoramaPx TraceNear(double x, double y, SurfaceLabel label, const PanoramaPx& other) const;
  Footprint MakeFootprint(SurfaceLabel label, const PanoramaPx& at, PanoramaPx dx,
                          PanoramaPx dy) const;
  static std::uint8_t Sample(const Footprint& footprint, double x, double y);
  bool PaintSmooth(int x, int y, int size, SurfaceLabel label);
  void PaintFine(int x, int y);
  void Set(int x, int y, SurfaceLabel label, std::uint8_t value) {
    const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                          static_cast<std::size_t>(x);
    labels_[i] = label;
    image_.pixels[i] = value;
  }

  SurfaceCaster& caster_;
  int width_, height_, grid_width_;
  std::vector<int> grid_;  // labels of every second pixel of every second row, cast when needed
  std::vector<SurfaceLabel>& labels_;
  GrayImage image_;
};

// The plane-induced map from the view to the panorama.
PanoramaPx Painter::Trace(double x, double y, SurfaceLabel label) const {
  const SurfaceInView& surface = caster_.surfaces()[label - std::size_t{1}];
  const SourceInView& view = caster_.sources()[static_cast<std::size_t>(surface.source_idx)];
  const Eigen::Vector3d ray = caster_.Ray(x, y);
  const PanoramaShare share =
      ShareOfDirection(view.cam_in_source + surface.Depth(ray) * (view.source_from_cam * ray));
  const PyramidLevel& full = view.source->levels.front();
  return {share.across * full.width_px, share.down * full.height_px};
}

PanoramaPx Painter::TraceNear(double x, double y, SurfaceLabel label,
                              const PanoramaPx& other) const {
  PanoramaPx at = Trace(x, y, label);
  const double width = SourceOf(label).levels.front().width_px;
  at.x += width * std::round((other.x - at.x) / width);
  return at;
}

// From the panorama's steps along a pixel's sides. The level suits the direction that is shrunk
// least; the other one is covered by taps, so that a wall seen at a slant keeps its detail.
Footprint Painter::MakeFootprint(SurfaceLabel label, const PanoramaPx& at, PanoramaPx dx,
                                 PanoramaPx dy) const {
  const RenderSource::Impl& source = SourceOf(label);
  const PyramidLevel& full = source.levels.front();
  // Columns crowd towards the poles.
  const double cosine = std::max(std::sin(std::numbers::pi * at.y / full.height_px), 1e-3);
  const double xx = dx.x * cosine, yx = dy.x * cosine;
  const double aa = xx * xx + dx.y * dx.y, bb = yx * yx + dy.y * dy.y, ab = xx * yx + dx.y * dy.y;
  const double mean = (aa + bb) / 2, spread = std::hypot((aa - bb) / 2, ab);
  const double longest = std::sqrt(mean + spread);
  const double shortest = std::sqrt(std::max(mean - spread, 0.0));
  // Direction in the view, of unit length, that is shrunk most.
  const double angle = 0.5 * std::atan2(2 * ab, aa - bb);
  const double along_x = std::cos(angle), along_y = std::sin(angle);

  const double wanted = std::max(shortest, longest / kMaxTaps);
  std::size_t level = 0;
  while (level + 1 < source.levels.size() &&
         wanted > double{kReach_px} / source.levels[level].x_scale) {
    ++level;
  }
  Footprint footprint;
  footprint.level = &source.levels[level];
  const double length_px = longest * footprint.level->x_scale;
  footprint.taps =
      std::clamp(static_cast<int>(std::ceil(length_px / double{kReach_px})), 1, kMaxTaps);
  const auto step = [&](double from_x, double from_y, double scale) {
    return static_cast<float>((from_x * along_x + from_y * along_y) * scale / footprint.taps);
  };
  footprint.x_step = step(dx.x, dy.x, footprint.level->x_scale);
  footprint.y_step = step(dx.y, dy.y, footprint.level->y_scale);
  return footprint;
}

std::uint8_t Painter::Sample(const Footprint& footprint, double x, double y) {
  const PyramidLevel& level = *footprint.level;
  const auto level_x = static_cast<float>(x * level.x_scale);
  const auto level_y = static_cast<float>(y * level.y_scale);
  if (footprint.taps == 1) return static_cast<std::uint8_t>(level.Sample(level_x, level_y) + 0.5F);
  float sum = 0;
  for (int tap = 0; tap < footprint.taps; ++tap) {
    const float offset = static_cast<float>(tap) - 0.5F * static_cast<float>(footprint.taps - 1);
    sum += level.Sample(level_x + offset * footprint.x_step, level_y + offset * footprint.y_step);
  }
  return static_cast<std::uint8_t>(sum / static_cast<float>(footprint.taps) + 0.5F);
}

// False, with nothing painted, where interpolation would be off.
bool Painter::PaintSmooth(int x, int y, int size, SurfaceLabel label) {
  const double half = size / 2.0;
  const PanoramaPx centre = Trace(x + half, y + half, label);
  const PanoramaPx p00 = TraceNear(x, y, label, centre);
  const PanoramaPx p10 = TraceNear(x + size, y, label, centre);
  const PanoramaPx p01 = TraceNear(x, y + size, label, centre);
  const PanoramaPx p11 = TraceNear(x + size, y + size, label, centre);
  const double x_bend = (p00.x + p10.x + p01.x + p11.x) / 4 - centre.x;
  const double y_bend = (p00.y + p10.y + p01.y + p11.y) / 4 - centre.y;
  if (!(std::max(std::abs(x_bend), std::abs(y_bend)) <= kMaxBend_px)) return false;

  const double inverse = 1.0 / size;
  const PanoramaPx dx{(p10.x + p11.x - p00.x - p01.x) * inverse / 2,
                      (p10.y + p11.y - p00.y - p01.y) * inverse / 2};
  const PanoramaPx dy{(p01.x + p11.x - p00.x - p10.x) * inverse / 2,
                      (p01.y + p11.y - p00.y - p10.y) * inverse / 2};
  const Footprint footprint = MakeFootprint(label, centre, dx, dy);
  for (int row = 0; row < std::min(size, height_ - y); ++row) {
    const double down = row * inverse;
    const PanoramaPx left{p00.x + down * (p01.x - p00.x), p00.y + down * (p01.y - p00.y)};
    const PanoramaPx right{p10.x + down * (p11.x - p10.x), p10.y + down * (p11.y - p10.y)};
    const PanoramaPx step{(right.x - left.x) * inverse, (right.y - left.y) * inverse};
    for (int column = 0; column < std::min(size, width_ - x); ++column) {
      Set(x + column, y + row, label,
          Sample(footprint, left.x + column * step.x, left.y + column * step.y));
    }
  }
  return true;
}

// The smallest block shows its first corner's surface, traced pixel by pixel.
void Painter::PaintFine(int x, int y) {
  const SurfaceLabel label = LabelAt(x, y);
  if (label == 0) return;
  const SurfaceInView& surface = caster_.surfaces()[label - std::size_t{1}];
  const PanoramaPx corner = Trace(x, y, label);
  const PanoramaPx beside = TraceNear(x + 1, y, label, corner);
  const PanoramaPx below = TraceNear(x, y + 1, label, corner);
  const Footprint footprint =
      MakeFootprint(label, corner, {beside.x - corner.x, beside.y - corner.y},
                    {below.x - corner.x, below.y - corner.y});
  for (int row = y; row < std::min(y + kFine_px, height_); ++row) {
    for (int column = x; column < std::min(x + kFine_px, width_); ++column) {
      if (!(surface.Depth(caster_.Ray(column, row)) > 0)) continue;  // past the plane's horizon
      const PanoramaPx at = TraceNear(column, row, label, corner);
      Set(column, row, label, Sample(footprint, at.x, at.y));
    }
  }
}

}  // namespace

GrayImage PaintView(SurfaceCaster& caster, const Camera& camera,
                    std::vector<SurfaceLabel>& labels) {
  Painter painter(caster, camera, labels);
  for (int y = 0; y < camera.height_px; y += kCoarse_px) {
    for (int x = 0; x < camera.width_px; x += kCoarse_px) painter.PaintBlock(x, y, kCoarse_px);
  }
  return painter.TakeImage();
}

}  // namespace panofix
