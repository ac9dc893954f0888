#include "common/map/manifest.h"

#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/log.h"

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

Json CameraJson(const Camera& c) {
  return {{"width_px", c.width_px},
          {"height_px", c.height_px},
          {"fx_px", c.fx_px},
          {"fy_px", c.fy_px},
          {"cx_px", c.cx_px},
          {"cy_px", c.cy_px},
          {"distortion_model", DistortionModelName(c.distortion_model)},
          {"distortion_coefficients", c.distortion}};
}

Camera CameraFrom(const Json& j) {
  Camera c;
  j.at("width_px").get_to(c.width_px);
  j.at("height_px").get_to(c.height_px);
  j.at("fx_px").get_to(c.fx_px);
  j.at("fy_px").get_to(c.fy_px);
  j.at("cx_px").get_to(c.cx_px);
  j.at("cy_px").get_to(c.cy_px);
  j.at("distortion_coefficients").get_to(c.distortion);
  const auto model = j.at("distortion_model").get<std::string>();
  if (model == DistortionModelName(DistortionModel::kRationalPolynomial)) {
    c.distortion_model = DistortionModel::kRationalPolynomial;
  } else if (model != DistortionModelName(DistortionModel::kPlumbBob)) {
    throw std::invalid_argument("distortion model '" + model + "' is unknown");
  }
  const Status status = c.Check();
  if (!status.ok()) throw std::invalid_argument("camera: " + status.message());
  return c;
}

Json FeaturesJson(const FeatureOptions& f) {
  return {{"equalization", EqualizationName(f.equalization)},
          {"clahe_clip_limit", f.clahe_clip_limit},
          {"clahe_tiles", f.clahe_tiles},
          {"max_sift", f.max_sift},
          {"sift_contrast_threshold", f.sift_contrast_threshold},
          {"max_mser", f.max_mser},
          {"root_sift", f.root_sift}};
}

FeatureOptions FeaturesFrom(const Json& j) {
  FeatureOptions f;
  const auto equalization = ParseEqualization(j.at("equalization").get<std::string>());
  if (!equalization.ok()) throw std::invalid_argument(equalization.status().message());
  f.equalization = *equalization;
  j.at("clahe_clip_limit").get_to(f.clahe_clip_limit);
  j.at("clahe_tiles").get_to(f.clahe_tiles);
  j.at("max_sift").get_to(f.max_sift);
  j.at("sift_contrast_threshold").get_to(f.sift_contrast_threshold);
  j.at("max_mser").get_to(f.max_mser);
  j.at("root_sift").get_to(f.root_sift);
  f.Check();
  return f;
}

Json LambertJson(const LambertParameters& p) {
  return {{"projection", "lambert_conformal_conic"},
          {"ellipsoid", "WGS84"},
          {"lat1_deg", p.lat1_deg},
          {"lat2_deg", p.lat2_deg},
          {"lat0_deg", p.lat0_deg},
          {"lon0_deg", p.lon0_deg},
          {"scale", p.scale},
          {"false_easting_m", p.false_easting_m},
          {"false_northing_m", p.false_northing_m}};
}

LambertParameters LambertFrom(const Json& j) {
  LambertParameters p;
  j.at("lat1_deg").get_to(p.lat1_deg);
  j.at("lat2_deg").get_to(p.lat2_deg);
  j.at("lat0_deg").get_to(p.lat0_deg);
  j.at("lon0_deg").get_to(p.lon0_deg);
  j.at("scale").get_to(p.scale);
  j.at("false_easting_m").get_to(p.false_easting_m);
  j.at("false_northing_m").get_to(p.false_northing_m);
  (void)MapFrame(p);  // throws where they make no cone
  return p;
}

// "1.2.3" as numbers.
std::array<int, 3> VersionFrom(const std::string& text) {
  std::array<int, 3> v{};
  int end = 0;
  if (std::sscanf(text.c_str(), "%5d.%5d.%5d%n", &v[0], &v[1], &v[2], &end) != 3 ||
      static_cast<std::size_t>(end) != text.size() || v[0] < 0 || v[1] < 0 || v[2] < 0) {
    throw std::invalid_argument("'" + text + "' is no version such as 1.2.3");
  }
  return v;
}

// Empty where this release of panofix may read the bundle.
std::string WhyNotThisRelease(const Manifest& m) {
  const auto own = VersionFrom(PANOFIX_VERSION);
  if (VersionFrom(m.runtime_min) > own) {
    return "is for panofix " + m.runtime_min +
           " or later, this is " PANOFIX_VERSION "; update panofix";
  }
  if (!m.runtime_before.empty() && VersionFrom(m.runtime_before) <= own) {
    return "is for panofix before " + m.runtime_before +
           ", this is " PANOFIX_VERSION "; get a newer bundle";
  }
  return {};
}

// A path that cannot leave the bundle's folder.
bool IsSafePath(const std::string& path) {
  if (path.empty() || path.size() > 256 || path.front() == '/' ||
      path.find('\\') != std::string::npos) {
    return false;
  }
  std::size_t begin = 0;
  while (begin <= path.size()) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    const std::string piece = path.substr(begin, end - begin);
    if (piece.empty() || piece == "." || piece == "..") return false;
    begin = end + 1;
  }
  return path.find('\0') == std::string::npos;
}

std::vector<BundlePart> PartsFrom(const Json& list) {
  std::vector<BundlePart> parts;
  std::set<std::string> seen;
  for (const Json& j : list) {
    BundlePart part;
    j.at("path").get_to(part.path);
    j.at("num_bytes").get_to(part.num_bytes);
    j.at("sha256").get_to(part.sha256);
    if (!IsSafePath(part.path))
      throw std::invalid_argument("part path '" + part.path + "' is not allowed");
    if (!seen.insert(part.path).second)
      throw std::invalid_argument("part '" + part.path + "' twice");
    if (part.sha256.size() != 64 ||
        part.sha256.find_first_not_of("0123456789abcdef") != std::string::npos) {
      throw std::invalid_argument("part '" + part.path + "': sha256 is not 64 hex digits");
    }
    parts.push_back(std::move(part));
  }
  return parts;
}

Manifest ManifestFrom(const Json& j) {
  Manifest m;
  m.minor = j.at("format").at("minor").get<int>();
  j.at("name").get_to(m.name);
  j.at("build").get_to(m.build);
  j.at("generator").get_to(m.generator);
  if (m.minor >= 1) {  // 2.0 did not say
    j.at("runtime").at("min").get_to(m.runtime_min);
    j.at("runtime").at("before").get_to(m.runtime_before);
    j.at("vocabulary_release").get_to(m.vocabulary_release);
  }
  m.map_frame = LambertFrom(j.at("map_frame"));
  m.camera = CameraFrom(j.at("camera"));
  m.features = FeaturesFrom(j.at("preprocessing"));
  const Json& errors = j.at("errors");
  errors.at("range_sigma_share").get_to(m.errors.range_sigma_share);
  errors.at("normal_sigma_deg").get_to(m.errors.normal_sigma_deg);
  errors.at("relief_sigma_m").get_to(m.errors.relief_sigma_m);
  errors.at("panorama_position_sigma_m").get_to(m.errors.panorama_position_sigma_m);
  errors.at("panorama_heading_sigma_deg").get_to(m.errors.panorama_heading_sigma_deg);
  const Json& provenance = j.at("provenance");
  provenance.at("source").get_to(m.provenance.source);
  provenance.at("licence").get_to(m.provenance.licence);
  provenance.at("height_datum").get_to(m.provenance.height_datum);
  provenance.at("data_set_sha256").get_to(m.provenance.data_set_sha256);
  m.provenance.options = provenance.at("options").dump();
  const Json& counts = j.at("counts");
  counts.at("panoramas").get_to(m.num_panoramas);
  counts.at("stations").get_to(m.num_stations);
  counts.at("views").get_to(m.num_views);
  counts.at("landmarks").get_to(m.num_landmarks);
  counts.at("set_aside").get_to(m.num_set_aside);
  counts.at("views_per_station").get_to(m.views_per_station);
  m.parts = PartsFrom(j.at("parts"));
  return m;
}

}  // namespace

std::string ToJson(const Manifest& m) {
  Json parts = Json::array();
  for (const BundlePart& part : m.parts) {
    parts.push_back({{"path", part.path}, {"num_bytes", part.num_bytes}, {"sha256", part.sha256}});
  }
  Json j = {{"format", {{"name", "panofix-bundle"}, {"major", m.major}, {"minor", m.minor}}},
            {"name", m.name},
            {"build", m.build},
            {"generator", m.generator},
            {"runtime", {{"min", m.runtime_min}, {"before", m.runtime_before}}},
            {"vocabulary_release", m.vocabulary_release},
            {"map_frame", LambertJson(m.map_frame)},
            {"camera", CameraJson(m.camera)},
            {"preprocessing", FeaturesJson(m.features)},
            {"errors",
             {{"range_sigma_share", m.errors.range_sigma_share},
              {"normal_sigma_deg", m.errors.normal_sigma_deg},
              {"relief_sigma_m", m.errors.relief_sigma_m},
              {"panorama_position_sigma_m", m.errors.panorama_position_sigma_m},
              {"panorama_heading_sigma_deg", m.errors.panorama_heading_sigma_deg}}},
            {"provenance",
             {{"source", m.provenance.source},
              {"licence", m.provenance.licence},
              {"height_datum", m.provenance.height_datum},
              {"data_set_sha256", m.provenance.data_set_sha256},
              {"options",
               m.provenance.options.empty() ? Json::object() : Json::parse(m.provenance.options)}}},
            {"counts",
             {{"panoramas", m.num_panoramas},
              {"stations", m.num_stations},
              {"views", m.num_views},
              {"landmarks", m.num_landmarks},
              {"set_aside", m.num_set_aside},
              {"views_per_station", m.views_per_station}}},
            {"parts", parts}};
  if (m.minor < 1) j.erase("runtime"), j.erase("vocabulary_release");
  return j.dump(1) + "\n";
}

Result<Manifest> ParseManifest(const std::string& text, const std::string& name) {
  if (text.size() > kMaxManifestBytes) {
    return Status(ErrorCode::kTooLarge, Format("%s: %zu bytes; a manifest has at most %zu",
                                               name.c_str(), text.size(), kMaxManifestBytes));
  }
  try {
    const Json j = Json::parse(text);
    if (j.at("format").at("name") != "panofix-bundle")
      throw std::invalid_argument("not a panofix bundle");
    const int major = j.at("format").at("major").get<int>();
    if (major != kBundleMajor) {
      return Status(
          ErrorCode::kUnsupportedVersion,
          Format("%s: bundle format %d, this program reads format %d; %s", name.c_str(), major,
                 kBundleMajor, major > kBundleMajor ? "update panofix" : "build the bundle again"));
    }
    Manifest manifest = ManifestFrom(j);
    const std::string why_not = WhyNotThisRelease(manifest);
    if (!why_not.empty()) return Status(ErrorCode::kUnsupportedVersion, name + ": " + why_not);
    return manifest;
  } catch (const std::exception& error) {
    return Status(ErrorCode::kBadData,
                  name + ": " + error.what() + "; fetch the bundle again or build it again");
  }
}

}  // namespace panofix
