#pragma once
// What the test town is asked to be: every byte it writes follows from these values.

#include <array>
#include <cstdint>

#include "common/geo/map_frame.h"

namespace panofix::town {

// Check() throws std::invalid_argument naming field, value and rule.
struct TownOptions {
  std::uint64_t seed = 1;
  Geodetic origin{48.8016, 2.1315, 130.0};  // WGS84 position of the town frame's zero

  // World.
  double slope = 0.02;          // typical ground slope, rise over run
  double rebuilt_share = 0.08;  // share of buildings that look different on the day of the drive
  bool look_alikes = false;     // repeat one facade and one car everywhere
  int num_blocks = 0;           // 0: one street; N: N x N blocks, panoramas on every street

  // Panoramas.
  bool write_panoramas = true;
  int num_panoramas = 20;           // ignored where num_blocks > 0
  double spacing_m = 11;            // along the street
  int pano_width_px = 3328;         // height is half of it
  double panorama_height_m = 2.5;   // above the ground
  double tilt_sigma_deg = 1;        // of a panorama's pitch and roll
  double depth_noise_share = 0.02;  // relative error of a depth plane's distance, one sigma
  double normal_noise_deg = 0.5;    // of a depth plane's normal, one sigma an axis
  double geotag_noise_m = 0.05;     // of the written position, one sigma an axis
  double heading_noise_deg = 0.1;   // of the written heading, one sigma

  // Drive.
  bool write_drive = true;
  int num_frames = 40;
  double frame_spacing_m = 0;  // 0: spread over the mapped route
  int num_off_map_frames = 0;  // after the others, in a street without panoramas
  double lane_offset_m = 1.8;  // to the right of the panoramas' track
  double camera_height_m = 1.6;
  double camera_yaw_deg = 0;  // clockwise from the vehicle's heading
  double camera_pitch_deg = 0;
  double hfov_deg = 57.6;
  int frame_width_px = 800, frame_height_px = 600;
  std::array<double, 5> distortion{};  // k1 k2 p1 p2 k3
  bool same_light = false;             // the drive sees the map's light, cars, people and posters

  // Rendering.
  int samples_per_pixel = 4;  // where geometry or shadow edges cross a pixel; 1 elsewhere
  int jpeg_quality = 90;
  int num_threads = 0;  // 0: all cores; never changes a byte

  void Check() const;
};

}  // namespace panofix::town
