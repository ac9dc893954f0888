#pragma once
// manifest.json: what a bundle is, byte by byte in schemas/bundle.md.

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera.h"
#include "common/features/features.h"
#include "common/geo/map_frame.h"

namespace panofix {

// Version of the bundle format that this code writes; it reads the same major with any minor.
inline constexpr int kBundleMajor = 2;
inline constexpr int kBundleMinor = 2;
inline constexpr char kManifestName[] = "manifest.json";
inline constexpr char kManifestHashName[] = "manifest.json.sha256";
inline constexpr char kManifestSignatureName[] = "manifest.json.minisig";
inline constexpr std::size_t kMaxManifestBytes = std::size_t{64} << 20;
inline constexpr std::size_t kMaxSignatureBytes = std::size_t{16} << 10;
// The oldest release of panofix that reads what this code writes.
inline constexpr char kOldestRuntime[] = "0.1.0";

// A file of the bundle beside the manifest.
struct BundlePart {
  std::string path;  // relative, '/' between folders, no "." or ".."
  std::uint64_t num_bytes = 0;
  std::string sha256;
};

// 1-sigma errors of the map that estimators weigh residuals with. The first three are in each
// point's range sigma already; they are kept for the record.
struct MapErrors {
  double range_sigma_share = 0.02;  // of a plane's distance
  double normal_sigma_deg = 0.5;    // of a plane's direction
  double relief_sigma_m = 0.15;     // off the plane: balconies and bays that the planes leave out
  double panorama_position_sigma_m = 0.05;
  double panorama_heading_sigma_deg = 0.1;
};

struct Provenance {
  std::string source, licence, height_datum = "ellipsoid";
  std::string data_set_sha256;  // of the panoramas' files, poses and links (schemas/bundle.md)
  std::string options;          // the builder's options as JSON text
};

struct Manifest {
  int major = kBundleMajor, minor = kBundleMinor;
  std::string name;
  std::int64_t build = 0;  // grows from release to release
  std::string generator;   // program and version
  // Releases of panofix that read it: from the first, before the second (empty: no end).
  std::string runtime_min = kOldestRuntime, runtime_before;
  std::string vocabulary_release;  // what visual words mean; empty in format 2.0
  LambertParameters map_frame;
  Camera camera;            // the vehicle's; views are cut with it, undistorted
  FeatureOptions features;  // preprocessing contract
  MapErrors errors;
  Provenance provenance;
  std::int64_t num_panoramas = 0, num_stations = 0, num_views = 0, num_landmarks = 0,
               num_set_aside = 0;
  int views_per_station = 0;
  std::vector<BundlePart> parts;  // sorted by path
};

// Equal manifests give equal text.
[[nodiscard]] std::string ToJson(const Manifest& manifest);
// kBadData, kUnsupportedVersion (another major, or not for this release of panofix) or kTooLarge;
// `name` is for messages.
[[nodiscard]] Result<Manifest> ParseManifest(const std::string& text, const std::string& name);

}  // namespace panofix
