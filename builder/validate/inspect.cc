#include "builder/validate/inspect.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/log.h"
#include "common/sign/utc_time.h"

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

double Distance_m(const MapPanorama& a, const MapPanorama& b) {
  return (a.map_from_pano.translation - b.map_from_pano.translation).head<2>().norm() /
         a.point_scale;
}

// Prim's tree over panoramas, edges up to `max_m`.
double TreeLength_m(const std::vector<MapPanorama>& panoramas, double max_m) {
  std::vector<double> nearest_m(panoramas.size(), 1e18);
  std::vector<bool> joined(panoramas.size(), false);
  double length_m = 0;
  for (std::size_t step = 0; step < panoramas.size(); ++step) {
    std::size_t next = panoramas.size();
    for (std::size_t i = 0; i < panoramas.size(); ++i) {
      if (!joined[i] && (next == panoramas.size() || nearest_m[i] < nearest_m[next])) next = i;
    }
    joined[next] = true;
    if (nearest_m[next] <= max_m) length_m += nearest_m[next];
    for (std::size_t i = 0; i < panoramas.size(); ++i) {
      nearest_m[i] = std::min(nearest_m[i], Distance_m(panoramas[next], panoramas[i]));
    }
  }
  return length_m;
}

struct Extent {
  double south_deg = 90, north_deg = -90, west_deg = 180, east_deg = -180;
};
Extent ExtentOf(const MapBundle& bundle) {
  Extent e;
  for (const MapPanorama& p : bundle.panoramas()) {
    e.south_deg = std::min(e.south_deg, p.position.lat_deg);
    e.north_deg = std::max(e.north_deg, p.position.lat_deg);
    e.west_deg = std::min(e.west_deg, p.position.lon_deg);
    e.east_deg = std::max(e.east_deg, p.position.lon_deg);
  }
  return e;
}

std::int64_t WithDepth(const MapBundle& bundle) {
  return std::count_if(bundle.panoramas().begin(), bundle.panoramas().end(),
                       [](const MapPanorama& p) { return p.has_depth; });
}

std::string Row(const std::string& name, const std::string& value) {
  return Format("%-14s %s\n", name.c_str(), value.c_str());
}

std::string StatedOr(const std::string& text) { return text.empty() ? "not stated" : text; }

std::string Readers(const Manifest& m) {
  if (m.minor < 1) return "not stated";
  const std::string from = "panofix " + m.runtime_min + " and later";
  return m.runtime_before.empty() ? from : from + ", before " + m.runtime_before;
}

std::string ProvenanceText(const Manifest& m) {
  std::string text = Row("source", StatedOr(m.provenance.source));
  text += Row("licence", StatedOr(m.provenance.licence));
  text += Row("heights", m.provenance.height_datum);
  text += Row("data set", StatedOr(m.provenance.data_set_sha256));
  const Json options = Json::parse(m.provenance.options.empty() ? "{}" : m.provenance.options);
  std::string label = "options";
  for (const auto& [name, value] : options.items()) {
    text += Row(label, name + " " + value.dump());
    label.clear();
  }
  return text;
}

Json ToJson(const SignatureState& signature) {
  Json j = {{"state", SignatureKindName(signature.kind)}, {"key", nullptr}, {"why", nullptr}};
  if (!signature.key_id.empty()) j["key"] = signature.key_id;
  if (!signature.status.ok()) j["why"] = signature.status.message();
  if (!signature.statement) return j;
  const ReleaseStatement& s = *signature.statement;
  j["created"] = FormatUtc(s.created_s);
  j["expires"] = FormatUtc(s.expires_s);
  j["revoked_keys"] = s.revoked_keys;
  j["quality"] = s.quality;
  return j;
}

}  // namespace

double RouteLength_m(const MapBundle& bundle) {
  const auto& panoramas = bundle.panoramas();
  std::set<std::pair<std::uint32_t, std::uint32_t>> links;
  for (std::uint32_t i = 0; i < panoramas.size(); ++i) {
    for (const std::uint32_t j : panoramas[i].links) links.emplace(std::min(i, j), std::max(i, j));
  }
  constexpr double kNeighbour_m = 80;
  if (links.empty()) return TreeLength_m(panoramas, kNeighbour_m);
  double length_m = 0;
  for (const auto& [i, j] : links) length_m += Distance_m(panoramas[i], panoramas[j]);
  return length_m;
}

std::uint64_t BundleBytes(const MapBundle& bundle) {
  // The manifest and its hash: 64 digits, two spaces, its name, a line break.
  std::uint64_t bytes =
      ToJson(bundle.manifest()).size() + 64 + 2 + std::string(kManifestName).size() + 1;
  for (const BundlePart& part : bundle.manifest().parts) bytes += part.num_bytes;
  return bytes;
}

std::string SignatureText(const SignatureState& signature) {
  std::string value = SignatureKindName(signature.kind);
  if (!signature.key_id.empty()) value += ", key " + signature.key_id;
  if (signature.kind == SignatureKind::kNotVerified) value += "; give --trusted-key";
  if (!signature.status.ok()) value += " (" + signature.status.message() + ")";
  std::string text = Row("signature", value);
  if (!signature.statement) return text;
  const ReleaseStatement& s = *signature.statement;
  text += Row("created", FormatUtc(s.created_s));
  text += Row("expires", FormatUtc(s.expires_s));
  for (const std::string& key : s.revoked_keys) text += Row("revokes", "key " + key);
  for (const auto& [name, figure] : s.quality)
    text += Row("quality", Format("%s %g", name.c_str(), figure));
  return text;
}

std::string SignatureJson(const SignatureState& signature) {
  return Json{{"signature", ToJson(signature)}}.dump(1) + "\n";
}

std::string InspectText(const MapBundle& bundle, const SignatureState& signature) {
  const Manifest& m = bundle.manifest();
  const Extent e = ExtentOf(bundle);
  const double length_m = RouteLength_m(bundle),
               mb = static_cast<double>(BundleBytes(bundle)) / 1e6;
  std::string text;
  const auto row = [&](const char* name, const std::string& value) { text += Row(name, value); };
  row("bundle", m.name + Format(", build %ld", static_cast<long>(m.build)));
  row("id", bundle.id());
  row("format", Format("%d.%d, written by %s", m.major, m.minor, m.generator.c_str()));
  row("read by", Readers(m));
  text += SignatureText(signature);
  text += ProvenanceText(m);
  row("camera",
      Format("%d x %d px, fx %.2f, fy %.2f, %s", m.camera.width_px, m.camera.height_px,
             m.camera.fx_px, m.camera.fy_px, DistortionModelName(m.camera.distortion_model)));
  row("features",
      Format("%s equalisation, %s, at most %d SIFT and %d MSER an image",
             EqualizationName(m.features.equalization), m.features.root_sift ? "RootSIFT" : "SIFT",
             m.features.max_sift, m.features.max_mser));
  row("map frame", Format("Lambert conformal conic, parallels %.6f and %.6f, origin %.6f, %.6f",
                          m.map_frame.lat1_deg, m.map_frame.lat2_deg, m.map_frame.lat0_deg,
                          m.map_frame.lon0_deg));
  row("coverage", Format("%.6f..%.6f N, %.6f..%.6f E, %.0f m of route", e.south_deg, e.north_deg,
                         e.west_deg, e.east_deg, length_m));
  row("panoramas",
      Format("%ld (%ld with depth, %ld set aside)", static_cast<long>(m.num_panoramas),
             static_cast<long>(WithDepth(bundle)), static_cast<long>(m.num_set_aside)));
  row("views", Format("%ld, %d at each of %ld stations", static_cast<long>(m.num_views),
                      m.views_per_station, static_cast<long>(m.num_stations)));
  row("landmarks", Format("%ld", static_cast<long>(m.num_landmarks)));
  row("vocabulary", StatedOr(m.vocabulary_release));
  row("words", Format("%u SIFT, %u MSER", bundle.vocabulary().sift.num_words,
                      bundle.vocabulary().mser.num_words));
  row("size",
      Format("%.1f MB, %.1f MB per km of route", mb, length_m > 0 ? mb / (length_m / 1000) : 0.0));
  for (const BundlePart& part : m.parts)
    row("", Format("%10.1f kB  %s", static_cast<double>(part.num_bytes) / 1e3, part.path.c_str()));
  return text;
}

std::string InspectJson(const MapBundle& bundle, const SignatureState& signature) {
  // The manifest as it stands, and what it does not say itself.
  Json j;
  const Extent e = ExtentOf(bundle);
  const double length_m = RouteLength_m(bundle);
  const auto bytes = static_cast<double>(BundleBytes(bundle));
  j["id"] = bundle.id();
  j["signature"] = ToJson(signature);
  j["manifest"] = Json::parse(ToJson(bundle.manifest()));
  j["coverage"] = {{"south_deg", e.south_deg}, {"north_deg", e.north_deg},
                   {"west_deg", e.west_deg},   {"east_deg", e.east_deg},
                   {"route_m", length_m},      {"panoramas_with_depth", WithDepth(bundle)}};
  j["num_bytes"] = BundleBytes(bundle);
  j["mb_per_km"] = length_m > 0 ? bytes / 1e6 / (length_m / 1000) : 0.0;
  return j.dump(1) + "\n";
}

}  // namespace panofix
