#include "builder/ingest/depth_report.h"

#include <charconv>
#include <nlohmann/json.hpp>

#include "common/base/log.h"

namespace panofix {
namespace {

const char* EncodingName(const DepthMap& map) {
  return map.planes().empty() ? "png" : map.is_zlib() ? "zlib" : "raw";
}

template <typename Vector>
nlohmann::ordered_json ToJson(const Vector& v) {
  return {v.x(), v.y(), v.z()};
}

}  // namespace

Result<DepthPixel> ParseDepthPixel(const std::string& text, const DepthMap& map) {
  DepthPixel pixel;
  const char* end = text.data() + text.size();
  const auto column = std::from_chars(text.data(), end, pixel.column);
  const bool has_comma = column.ec == std::errc() && column.ptr != end && *column.ptr == ',';
  const auto row = has_comma ? std::from_chars(column.ptr + 1, end, pixel.row) : column;
  if (!has_comma || row.ec != std::errc() || row.ptr != end) {
    return Status(ErrorCode::kInvalidArgument,
                  "pixel '" + text + "' is not COL,ROW; give two whole numbers, e.g. 256,150");
  }
  if (pixel.column < 0 || pixel.column >= map.width() || pixel.row < 0 ||
      pixel.row >= map.height()) {
    return Status(ErrorCode::kInvalidArgument,
                  Format("pixel %d,%d lies outside the %dx%d depth; columns are 0..%d, rows 0..%d",
                         pixel.column, pixel.row, map.width(), map.height(), map.width() - 1,
                         map.height() - 1));
  }
  return pixel;
}

std::string DepthReportText(const DepthMap& map, const std::string& name,
                            std::span<const DepthPixel> pixels) {
  std::string text =
      Format("%s: %s, %dx%d", name.c_str(), EncodingName(map), map.width(), map.height());
  if (!map.planes().empty()) text += Format(", %zu planes", map.planes().size());
  text += "\n";
  if (map.is_placeholder()) text += "placeholder, not a measurement: the panorama has no depth\n";
  text += Format("surface: %.1f %% of the pixels\n", 100 * map.SurfaceShare());
  if (const auto ground = map.GroundPlane()) {
    const DepthPlane& plane = map.planes()[static_cast<std::size_t>(*ground)];
    const Eigen::Vector3f& n = plane.normal_in_pano;
    text += Format("ground: plane %d, d %.4f m, normal %.4f %.4f %.4f\n", *ground, plane.d_m, n.x(),
                   n.y(), n.z());
  } else {
    text += "ground: none\n";
  }
  for (const DepthPixel& pixel : pixels) {
    text += Format("pixel %d,%d: ", pixel.column, pixel.row);
    const auto hit = map.CastPixel(pixel.column, pixel.row);
    if (!hit) {
      text += "no surface\n";
      continue;
    }
    text += Format("%.4f m", hit->range_m);
    if (hit->surface_idx > 0) text += Format(", plane %d", hit->surface_idx);
    text += Format(", normal %.4f %.4f %.4f\n", hit->normal_in_pano.x(), hit->normal_in_pano.y(),
                   hit->normal_in_pano.z());
  }
  return text;
}

std::string DepthReportJson(const DepthMap& map, const std::string& name,
                            std::span<const DepthPixel> pixels) {
  nlohmann::ordered_json report;
  report["file"] = name;
  report["encoding"] = EncodingName(map);
  report["width"] = map.width();
  report["height"] = map.height();
  report["planes"] = map.planes().size();
  report["placeholder"] = map.is_placeholder();
  report["surface_share"] = map.SurfaceShare();
  report["ground_plane"] = report["ground_d_m"] = report["ground_normal"] = nullptr;
  if (const auto ground = map.GroundPlane()) {
    const DepthPlane& plane = map.planes()[static_cast<std::size_t>(*ground)];
    report["ground_plane"] = *ground;
    report["ground_d_m"] = static_cast<double>(plane.d_m);
    report["ground_normal"] = ToJson(plane.normal_in_pano.cast<double>().eval());
  }
  report["pixels"] = nlohmann::ordered_json::array();
  for (const DepthPixel& pixel : pixels) {
    const auto hit = map.CastPixel(pixel.column, pixel.row);
    nlohmann::ordered_json entry = {{"col", pixel.column},
                                    {"row", pixel.row},
                                    {"range_m", nullptr},
                                    {"plane", map.PlaneIndex(pixel.column, pixel.row)},
                                    {"normal", nullptr}};
    if (hit) {
      entry["range_m"] = hit->range_m;
      entry["normal"] = ToJson(hit->normal_in_pano);
    }
    report["pixels"].push_back(entry);
  }
  // A file name need not be UTF-8; what is not is replaced rather than refused.
  return report.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace panofix
