#pragma once
// A synthetic street: panoramas along it, façades, ground and ends as planes, textured points on
// them, and the observations that views of it would hold. Errors are drawn from the model that the
// layer assumes; the truth is kept.

#include <cstdint>
#include <vector>

#include "builder/landmarks/landmark_layer.h"
#include "common/base/rng.h"

namespace panofix {

struct StreetOptions {
  int num_panoramas = 5;
  double spacing_m = 8;
  int num_points = 600;             // spread over all surfaces
  double position_sigma_m = 0.05;   // of the geotags drawn, each axis
  double heading_sigma_deg = 0.1;   // each axis
  double range_sigma_share = 0.02;  // of each plane's distance
  double normal_sigma_deg = 0.5;
  double relief_sigma_m = 0.05;
  double keypoint_share = 1;    // of the keypoint error that the layer assumes
  double outlier_share = 0;     // points that another panorama sees elsewhere, looking the same
  int views_per_point = 2;      // of each panorama that show a point
  double descriptor_noise = 6;  // each byte, 1 sigma
  double max_range_m = 25;
  double focal_px = 500;
  bool planes_are_known = true;  // false: rasters
};

struct Street {
  std::vector<LandmarkPanorama> panoramas;  // with the errors
  std::vector<Rigid3> true_local_from_pano;
  std::vector<std::vector<DepthPlane>> true_planes;
  std::vector<Eigen::Vector3d> points_in_local;  // the truth
  std::vector<LandmarkObservation> observations;
  std::vector<int> point_of;  // of each observation; -1 = outlier
  std::vector<std::array<std::uint8_t, kDescriptorSize>> storage;           // of the descriptors
  std::vector<std::array<std::uint8_t, kDescriptorSize>> true_descriptors;  // of each point
  MapErrors errors;
  double focal_px = 0;
};

// Observations' spans point into `storage`: the street is moved, never copied.
[[nodiscard]] Street MakeStreet(const StreetOptions& options, std::uint64_t seed);

// A RootSIFT-like descriptor: 128 bytes of length 512.
[[nodiscard]] std::array<std::uint8_t, kDescriptorSize> RandomDescriptor(Rng* rng);
[[nodiscard]] std::array<std::uint8_t, kDescriptorSize> Disturbed(
    const std::array<std::uint8_t, kDescriptorSize>& descriptor, double sigma, Rng* rng);

// All of a layer's numbers as bytes.
[[nodiscard]] std::vector<std::uint8_t> Bytes(const LandmarkLayer& layer);

// Index of the point whose descriptor a landmark's is nearest to.
[[nodiscard]] std::size_t PointOf(const Street& street, const Landmark& landmark);

}  // namespace panofix
