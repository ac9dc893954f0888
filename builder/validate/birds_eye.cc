#include "builder/validate/birds_eye.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "builder/validate/score.h"
#include "common/base/log.h"

namespace panofix {
namespace {

constexpr double kWidth_px = 1100, kMargin_px = 60, kLegend_px = 60;
constexpr double kRedError_m = 1.0;

// Map metres to picture pixels, north up.
class Canvas {
 public:
  explicit Canvas(const std::vector<Eigen::Vector2d>& points) {
    min_ = max_ = points.front();
    for (const auto& p : points) min_ = min_.cwiseMin(p), max_ = max_.cwiseMax(p);
    const Eigen::Vector2d extent = (max_ - min_).cwiseMax(5.0);
    scale_ = (kWidth_px - 2 * kMargin_px) / std::max(extent.x(), extent.y());
    width_px_ = std::max(560.0, extent.x() * scale_ + 2 * kMargin_px);
    height_px_ = extent.y() * scale_ + 2 * kMargin_px + kLegend_px;
  }
  [[nodiscard]] Eigen::Vector2d At(const Eigen::Vector2d& p) const {
    return {kMargin_px + (p.x() - min_.x()) * scale_,
            kMargin_px + kLegend_px + (max_.y() - p.y()) * scale_};
  }
  [[nodiscard]] double scale() const { return scale_; }
  [[nodiscard]] double width_px() const { return width_px_; }
  [[nodiscard]] double height_px() const { return height_px_; }

 private:
  Eigen::Vector2d min_, max_;
  double scale_ = 1, width_px_ = 0, height_px_ = 0;
};

std::string Line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const char* style) {
  return Format("<line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f' %s/>\n", a.x(), a.y(), b.x(), b.y(),
                style);
}
std::string Circle(const Eigen::Vector2d& c, double radius_px, const std::string& style) {
  return Format("<circle cx='%.1f' cy='%.1f' r='%.1f' %s/>\n", c.x(), c.y(), radius_px,
                style.c_str());
}
std::string Text(double x, double y, const std::string& text) {
  return Format("<text x='%.1f' y='%.1f' font-family='sans-serif' font-size='13'>%s</text>\n", x, y,
                text.c_str());
}

std::string ErrorColor(double error_m) {
  if (error_m > kFalseFix_m) return "#d0d";
  const double share = std::min(1.0, error_m / kRedError_m);
  return Format("hsl(%.0f,85%%,42%%)", 120 * (1 - share));
}

std::string Legend(const Canvas& canvas) {
  std::string svg;
  const double y = 26;
  svg += Circle({70, y - 4}, 4, "fill='#999'") + Text(80, y, "panorama");
  svg +=
      Line({160, y - 4}, {190, y - 4}, "stroke='#1a6fd0' stroke-width='2'") + Text(196, y, "truth");
  for (int i = 0; i <= 4; ++i) {
    svg += Circle({260 + 16.0 * i, y - 4}, 6, "fill='" + ErrorColor(i * kRedError_m / 4) + "'");
  }
  svg += Text(338, y, Format("fix, error 0 to %g m and more", kRedError_m));
  svg += Circle({70, y + 18}, 6, "fill='#d0d'") +
         Text(82, y + 22, Format("false fix (> %g m)", kFalseFix_m));
  svg += Circle({216, y + 18}, 4, "fill='none' stroke='#1a6fd0'") + Text(226, y + 22, "no fix") +
         Circle({282, y + 18}, 6, "fill='#ddd' stroke='#000' stroke-dasharray='2,2'") +
         Text(294, y + 22, "degraded");
  double bar_m = 1;
  while (bar_m * canvas.scale() < 60)
    bar_m *= bar_m == 1 || std::fmod(std::log10(bar_m), 1) == 0 ? 5 : 2;
  svg +=
      Line({380, y + 18}, {380 + bar_m * canvas.scale(), y + 18}, "stroke='#000' stroke-width='3'");
  return svg + Text(386 + bar_m * canvas.scale(), y + 22, Format("%g m", bar_m));
}

}  // namespace

std::string BirdsEyeSvg(const MapBundle& bundle, const Drive& drive,
                        const std::vector<PoseRow>& poses) {
  const auto on_map = [&](const Geodetic& g) -> Eigen::Vector2d {
    return bundle.frame().ToMap(g).head<2>();
  };
  std::vector<Eigen::Vector2d> all;
  for (const MapPanorama& p : bundle.panoramas())
    all.emplace_back(p.map_from_pano.translation.head<2>());
  std::map<std::int64_t, Eigen::Vector2d> truth_of;
  for (const TruthPose& t : drive.truth) truth_of[t.timestamp_ns] = on_map(t.position);
  for (const auto& [time, p] : truth_of) all.push_back(p);
  // Fixes do not stretch the picture: a false one far away would shrink the rest to a dot.
  const Canvas canvas(all);

  std::string svg = Format(
      "<svg xmlns='http://www.w3.org/2000/svg' width='%.0f' height='%.0f' viewBox='0 0 %.0f "
      "%.0f'>\n"
      "<rect width='100%%' height='100%%' fill='white'/>\n",
      canvas.width_px(), canvas.height_px(), canvas.width_px(), canvas.height_px());
  for (const MapPanorama& p : bundle.panoramas()) {
    const Eigen::Vector2d here = canvas.At(p.map_from_pano.translation.head<2>());
    for (const std::uint32_t link : p.links) {
      svg += Line(here, canvas.At(bundle.panoramas()[link].map_from_pano.translation.head<2>()),
                  "stroke='#ccc'");
    }
    svg += Circle(here, 4, "fill='#999'");
  }
  const Eigen::Vector2d* previous = nullptr;
  for (const auto& [time, p] : truth_of) {
    if (previous != nullptr)
      svg += Line(canvas.At(*previous), canvas.At(p), "stroke='#1a6fd0' stroke-width='2'");
    previous = &p;
  }
  for (const PoseRow& row : poses) {
    const auto truth = truth_of.find(row.timestamp_ns);
    if (row.status == FixStatus::kNoFix || !row.pose) {
      if (truth != truth_of.end())
        svg += Circle(canvas.At(truth->second), 4, "fill='white' stroke='#1a6fd0'");
      continue;
    }
    const Eigen::Vector2d here = on_map(row.pose->position);
    std::string color = "#1a6fd0";
    if (truth != truth_of.end()) {
      // A degraded pose is never a false fix, however red.
      const double error_m = (here - truth->second).norm();
      color = ErrorColor(row.status == FixStatus::kFix ? error_m : std::min(error_m, kFalseFix_m));
      svg += Line(canvas.At(here), canvas.At(truth->second), "stroke='#555'");
    }
    const char* edge = row.status == FixStatus::kDegraded ? "' stroke='#000' stroke-dasharray='2,2'"
                                                          : "' stroke='#333'";
    svg += Circle(canvas.At(here), 6, "fill='" + color + edge);
  }
  return svg + Legend(canvas) + "</svg>\n";
}

}  // namespace panofix
