// panofix-town: writes a synthetic town with exact truth, for tests, demonstrations and
// measurements.
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <thread>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/status.h"
#include "tests/town/writer.h"

namespace {

using panofix::town::TownOptions;

constexpr const char* kDescription =
    "Renders a synthetic town: street panoramas with plane-coded depth, and a drive through the "
    "same\n"
    "streets on another day (other light, cars, people, posters), with the exact truth of every "
    "pose.\n\n"
    "  panofix-town --out /tmp/town --seed 7\n"
    "  panofix-builder build --panoramas /tmp/town/panoramas.geojson --camera "
    "/tmp/town/camera.yaml --out /tmp/map\n"
    "  panofix-builder validate /tmp/map --drive /tmp/town/drive\n";
constexpr const char* kFooter =
    "Equal arguments give equal bytes, whatever the number of threads.\n"
    "An easy town: --same-light --depth-noise-share 0 --normal-noise-deg 0 --geotag-noise-m 0 "
    "--rebuilt-share 0\n"
    "A hard one:   --camera-yaw-deg -45 --look-alikes --rebuilt-share 0.3 --off-map-frames 20";

void AddWorldOptions(CLI::App& app, TownOptions& o, std::vector<double>& origin) {
  app.add_option("--origin", origin, "latitude,longitude,height of the town")
      ->delimiter(',')
      ->expected(3)
      ->capture_default_str();
  app.add_option("--slope", o.slope, "typical slope of the ground, rise over run")
      ->capture_default_str();
  app.add_option("--rebuilt-share", o.rebuilt_share,
                 "share of facades that changed before the drive")
      ->capture_default_str();
  app.add_flag("--look-alikes", o.look_alikes, "repeat one facade and one car everywhere");
  app.add_option("--scale", o.num_blocks,
                 "a grid of BLOCKS x BLOCKS with panoramas on every street; 0: one street")
      ->capture_default_str();
}

void AddPanoramaOptions(CLI::App& app, TownOptions& o) {
  app.add_option("--panoramas", o.num_panoramas, "how many (one street)")->capture_default_str();
  app.add_option("--spacing-m", o.spacing_m, "distance between panoramas")->capture_default_str();
  app.add_option("--pano-width-px", o.pano_width_px, "width; the height is half")
      ->capture_default_str();
  app.add_option("--panorama-height-m", o.panorama_height_m, "height above the ground")
      ->capture_default_str();
  app.add_option("--tilt-sigma-deg", o.tilt_sigma_deg, "of pitch and roll")->capture_default_str();
  app.add_option("--depth-noise-share", o.depth_noise_share,
                 "relative error of a depth plane's distance")
      ->capture_default_str();
  app.add_option("--normal-noise-deg", o.normal_noise_deg, "error of a depth plane's normal")
      ->capture_default_str();
  app.add_option("--geotag-noise-m", o.geotag_noise_m, "error of the written positions, each axis")
      ->capture_default_str();
  app.add_option("--heading-noise-deg", o.heading_noise_deg, "error of the written headings")
      ->capture_default_str();
}

void AddDriveOptions(CLI::App& app, TownOptions& o, std::vector<double>& distortion) {
  app.add_option("--frames", o.num_frames, "camera frames on the mapped streets")
      ->capture_default_str();
  app.add_option("--frame-spacing-m", o.frame_spacing_m,
                 "distance between frames; 0: spread over the route")
      ->capture_default_str();
  app.add_option("--off-map-frames", o.num_off_map_frames,
                 "frames after these, in a street without panoramas")
      ->capture_default_str();
  app.add_option("--lane-offset-m", o.lane_offset_m, "to the right of the panoramas' track")
      ->capture_default_str();
  app.add_option("--camera-height-m", o.camera_height_m, "above the ground")->capture_default_str();
  app.add_option("--camera-yaw-deg", o.camera_yaw_deg, "clockwise from the vehicle's heading")
      ->capture_default_str();
  app.add_option("--camera-pitch-deg", o.camera_pitch_deg, "positive looks up")
      ->capture_default_str();
  app.add_option("--hfov-deg", o.hfov_deg, "horizontal field of view")->capture_default_str();
  app.add_option("--frame-width-px", o.frame_width_px)->capture_default_str();
  app.add_option("--frame-height-px", o.frame_height_px)->capture_default_str();
  app.add_option("--distortion", distortion, "k1,k2,p1,p2[,k3] of the camera")
      ->delimiter(',')
      ->expected(4, 5);
  app.add_flag("--same-light", o.same_light,
               "the drive sees the map's light, cars, people and posters");
}

int Run(int argc, char** argv) {
  TownOptions options;
  std::string out;
  std::vector<double> origin{options.origin.lat_deg, options.origin.lon_deg,
                             options.origin.height_m},
      distortion;
  bool no_panoramas = false, no_drive = false;
  CLI::App app(kDescription, "panofix-town");
  app.footer(kFooter);
  app.add_option("--out", out, "folder to write; new, empty or an earlier town's")->required();
  app.add_option("--seed", options.seed, "everything random follows from it")->required();
  AddWorldOptions(app, options, origin);
  AddPanoramaOptions(app, options);
  AddDriveOptions(app, options, distortion);
  app.add_option("--samples-per-pixel", options.samples_per_pixel,
                 "rays where an edge crosses a pixel")
      ->capture_default_str();
  app.add_option("--jpeg-quality", options.jpeg_quality)->capture_default_str();
  app.add_option("--threads", options.num_threads, "0: all cores")->capture_default_str();
  app.add_flag("--no-panoramas", no_panoramas, "write only the drive");
  app.add_flag("--no-drive", no_drive, "write only the panoramas");
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "panofix-town: %s; see panofix-town --help\n", error.what());
    return panofix::ExitCode(panofix::ErrorCode::kInvalidArgument);
  }
  options.origin = {origin[0], origin[1], origin[2]};
  std::copy(distortion.begin(), distortion.end(), options.distortion.begin());
  options.write_panoramas = !no_panoramas;
  options.write_drive = !no_drive;
  options.Check();
  panofix::InstallCancelHandlers();
  const auto threads = static_cast<std::size_t>(
      options.num_threads > 0 ? static_cast<unsigned>(options.num_threads)
                              : std::max(1u, std::thread::hardware_concurrency()));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
  panofix::town::WriteTown(panofix::town::Town::Generate(options), out);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return Run(argc, argv);
  } catch (const panofix::Error& error) {
    std::fprintf(stderr, "panofix-town: %s\n", error.what());
    return panofix::ExitCode(error.code());
  } catch (const std::invalid_argument& error) {
    std::fprintf(stderr, "panofix-town: %s; see panofix-town --help\n", error.what());
    return panofix::ExitCode(panofix::ErrorCode::kInvalidArgument);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "panofix-town: %s\n", error.what());
    return panofix::ExitCode(panofix::ErrorCode::kInternal);
  }
}
