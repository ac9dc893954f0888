#include "tests/town/options.h"

#include <cmath>
#include <stdexcept>

#include "common/base/log.h"

namespace panofix::town {
namespace {

void InRange(const char* name, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw std::invalid_argument(Format("%s is %g; it must lie in %g..%g", name, value, low, high));
  }
}

}  // namespace

void TownOptions::Check() const {
  InRange("origin latitude", origin.lat_deg, -85, 85);
  InRange("origin longitude", origin.lon_deg, -180, 180);
  InRange("origin height", origin.height_m, -500, 9000);
  InRange("slope", slope, -0.15, 0.15);
  InRange("rebuilt-share", rebuilt_share, 0, 1);
  InRange("scale", num_blocks, 0, 40);
  InRange("panoramas", num_panoramas, 1, 20000);
  InRange("spacing-m", spacing_m, 2, 60);
  InRange("pano-width-px", pano_width_px, 64, 16384);
  if (pano_width_px % 2 != 0) {
    throw std::invalid_argument(Format("pano-width-px is %d; it must be even", pano_width_px));
  }
  InRange("panorama-height-m", panorama_height_m, 0.5, 5);
  InRange("tilt-sigma-deg", tilt_sigma_deg, 0, 10);
  InRange("depth-noise-share", depth_noise_share, 0, 0.3);
  InRange("normal-noise-deg", normal_noise_deg, 0, 20);
  InRange("geotag-noise-m", geotag_noise_m, 0, 10);
  InRange("heading-noise-deg", heading_noise_deg, 0, 20);
  InRange("frames", num_frames, 0, 100000);
  InRange("frame-spacing-m", frame_spacing_m, 0, 60);
  InRange("off-map-frames", num_off_map_frames, 0, 10000);
  if (num_blocks == 1 && num_off_map_frames > 0) {
    throw std::invalid_argument("scale is 1 with off-map frames; it must be 0 or at least 2");
  }
  InRange("lane-offset-m", lane_offset_m, -2.5, 2.5);
  InRange("camera-height-m", camera_height_m, 0.3, 4);
  InRange("camera-yaw-deg", camera_yaw_deg, -360, 360);
  InRange("camera-pitch-deg", camera_pitch_deg, -60, 60);
  InRange("hfov-deg", hfov_deg, 10, 150);
  InRange("frame-width-px", frame_width_px, 16, 8192);
  InRange("frame-height-px", frame_height_px, 16, 8192);
  for (const double k : distortion) InRange("distortion", k, -2, 2);
  InRange("samples-per-pixel", samples_per_pixel, 1, 16);
  InRange("jpeg-quality", jpeg_quality, 10, 100);
  InRange("threads", num_threads, 0, 1024);
}

}  // namespace panofix::town
