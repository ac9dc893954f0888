#include "tests/town/writer.h"

#include <tbb/parallel_for.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/base/rng.h"
#include "common/base/status.h"
#include "tests/town/depth_planes.h"

namespace panofix::town {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

void WriteBytes(const fs::path& path, const char* data, std::size_t size) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file.write(data, static_cast<std::streamsize>(size));
  file.close();
  if (!file)
    throw Error(ErrorCode::kIo,
                path.string() + ": not written; free some disk space or pick another --out");
}

void WriteText(const fs::path& path, const std::string& text) {
  WriteBytes(path, text.data(), text.size());
}

void WriteJpeg(const fs::path& path, ByteImage& image, int quality) {
  const cv::Mat view(image.height, image.width, CV_8UC3, image.bgr.data());
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".jpg", view, bytes, {cv::IMWRITE_JPEG_QUALITY, quality})) {
    throw Error(ErrorCode::kInternal, path.string() + ": not encoded; ask for a smaller picture");
  }
  WriteBytes(path, reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

void MakeFolder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error)
    throw Error(ErrorCode::kIo, path.string() + ": " + error.message() + "; pick another --out");
}

void StopIfCancelled() {
  if (CancelRequested())
    throw Error(ErrorCode::kCancelled, "stopped; the town is incomplete, run the command again");
}

std::string PoseColumns(const TownGeodesy& geodesy, const Eigen::Vector3d& position,
                        const Eigen::Matrix3d& town_from_body) {
  const Geodetic at = geodesy.ToGeodetic(position);
  const Attitude a = geodesy.ToAttitude(position, town_from_body);
  return Format("%.12f,%.12f,%.6f,%.10f,%.10f,%.10f", at.lat_deg, at.lon_deg, at.height_m,
                a.heading_deg, a.pitch_deg, a.roll_deg);
}

// A number as a file carries it: fixed decimals, so that the text is the same everywhere.
double Rounded(double value, int decimals) { return std::stod(Format("%.*f", decimals, value)); }

Json PanoramaFeature(const Town& town, std::size_t index, bool has_depth) {
  const TownOptions& options = town.options();
  const PanoramaPose& pose = town.layout().panoramas[index];
  Rng rng(options.seed, "geotag/" + pose.id);
  const Eigen::Vector3d error(rng.Normal(), rng.Normal(), rng.Normal());
  const Eigen::Vector3d& position = pose.town_from_pano.translation;
  const Geodetic at = town.geodesy().ToGeodetic(position + options.geotag_noise_m * error);
  const Attitude attitude =
      town.geodesy().ToAttitude(position, pose.town_from_pano.rotation.toRotationMatrix());
  const double heading =
      std::fmod(attitude.heading_deg + options.heading_noise_deg * rng.Normal() + 360, 360);
  Json properties;
  properties["image"] = "panoramas/" + pose.id + ".jpg";
  properties["depth"] = has_depth ? Json("panoramas/" + pose.id + ".gsv") : Json(nullptr);
  properties["heading"] = Rounded(heading, 10);
  properties["pitch"] = Rounded(attitude.pitch_deg, 10);
  properties["roll"] = Rounded(attitude.roll_deg, 10);
  properties["links"] = pose.links;
  properties["captured_at"] =
      Format("2023-05-14T%02d:%02d:%02dZ", static_cast<int>(8 + index / 3600 % 12),
             static_cast<int>(index / 60 % 60), static_cast<int>(index % 60));
  Json feature;
  feature["type"] = "Feature";
  feature["id"] = pose.id;
  feature["geometry"] = {
      {"type", "Point"},
      {"coordinates", {Rounded(at.lon_deg, 12), Rounded(at.lat_deg, 12), Rounded(at.height_m, 6)}}};
  feature["properties"] = std::move(properties);
  return feature;
}

Json OptionsJson(const TownOptions& o) {
  Json j;
  j["origin"] = {o.origin.lat_deg, o.origin.lon_deg, o.origin.height_m};
  j["slope"] = o.slope, j["rebuilt_share"] = o.rebuilt_share, j["look_alikes"] = o.look_alikes;
  j["scale_blocks"] = o.num_blocks, j["panoramas"] = o.num_panoramas, j["spacing_m"] = o.spacing_m;
  j["pano_width_px"] = o.pano_width_px, j["panorama_height_m"] = o.panorama_height_m;
  j["tilt_sigma_deg"] = o.tilt_sigma_deg, j["depth_noise_share"] = o.depth_noise_share;
  j["normal_noise_deg"] = o.normal_noise_deg, j["geotag_noise_m"] = o.geotag_noise_m;
  j["heading_noise_deg"] = o.heading_noise_deg, j["frames"] = o.num_frames;
  j["frame_spacing_m"] = o.frame_spacing_m, j["off_map_frames"] = o.num_off_map_frames;
  j["lane_offset_m"] = o.lane_offset_m, j["camera_height_m"] = o.camera_height_m;
  j["camera_yaw_deg"] = o.camera_yaw_deg, j["camera_pitch_deg"] = o.camera_pitch_deg;
  j["hfov_deg"] = o.hfov_deg, j["frame_width_px"] = o.frame_width_px,
  j["frame_height_px"] = o.frame_height_px;
  j["distortion"] = o.distortion, j["same_light"] = o.same_light;
  j["samples_per_pixel"] = o.samples_per_pixel, j["jpeg_quality"] = o.jpeg_quality;
  return j;
}

}  // namespace

void PrepareFolder(const fs::path& directory, const TownOptions& options) {
  std::error_code error;
  const bool used = fs::exists(directory, error) && !fs::is_empty(directory, error);
  if (error || (used && !fs::exists(directory / "town.json"))) {
    throw Error(
        ErrorCode::kInvalidArgument,
        directory.string() + ": not empty and not a town's folder; name an empty or new one");
  }
  if (options.write_panoramas) {
    for (const char* part : {"panoramas", "panoramas.geojson", "truth_panoramas.csv"})
      fs::remove_all(directory / part, error);
    MakeFolder(directory / "panoramas");
  }
  if (options.write_drive) {
    fs::remove_all(directory / "drive", error);
    MakeFolder(directory / "drive" / "images");
  }
  MakeFolder(directory);
  // The mark by which a later run knows the folder, even where this run is stopped.
  WriteText(directory / "town.json", "{}\n");
}

void WritePanoramas(const Town& town, const fs::path& directory) {
  const auto& panoramas = town.layout().panoramas;
  std::string truth = "id,latitude,longitude,altitude,heading,pitch,roll\n";
  Json features = Json::array();
  Progress progress("render", static_cast<std::int64_t>(panoramas.size()), "panoramas");
  for (std::size_t i = 0; i < panoramas.size(); ++i) {
    StopIfCancelled();
    const PanoramaPose& pose = panoramas[i];
    ByteImage image = RenderPanorama(town, i);
    WriteJpeg(directory / "panoramas" / (pose.id + ".jpg"), image, town.options().jpeg_quality);
    // Every reading of the format in turn: raw and zlib, both alphabets, padded and not.
    const GsvForm form{(i & 1u) != 0, (i & 2u) == 0, (i & 4u) != 0};
    const PlaneDepth depth =
        SeePlanes(town, pose.town_from_pano, Rng(town.options().seed, "depth/" + pose.id));
    WriteText(directory / "panoramas" / (pose.id + ".gsv"), EncodeGsv(depth, form));
    features.push_back(PanoramaFeature(town, i, true));
    truth += pose.id + "," +
             PoseColumns(town.geodesy(), pose.town_from_pano.translation,
                         pose.town_from_pano.rotation.toRotationMatrix()) +
             "\n";
    progress.Add();
  }
  Json collection;
  collection["type"] = "FeatureCollection";
  collection["source"] =
      Format("panofix-town, seed %llu", static_cast<unsigned long long>(town.options().seed));
  collection["licence"] = "CC0-1.0: a synthetic town, nobody lives there";
  collection["height_datum"] = "ellipsoid";
  collection["features"] = std::move(features);
  WriteText(directory / "panoramas.geojson", collection.dump(1) + "\n");
  WriteText(directory / "truth_panoramas.csv", truth);
}

void WriteDrive(const Town& town, const fs::path& directory) {
  const auto& frames = town.layout().frames;
  const fs::path drive = directory / "drive";
  std::string list = "timestamp_ns,image\n",
              truth = "timestamp_ns,latitude,longitude,altitude,heading,pitch,roll\n";
  Progress progress("render", static_cast<std::int64_t>(frames.size()), "frames");
  tbb::parallel_for(std::size_t{0}, frames.size(), [&](std::size_t i) {
    if (CancelRequested()) return;
    ByteImage image = RenderFrame(town, i);
    WriteJpeg(drive / "images" / Format("%06zu.jpg", i), image, town.options().jpeg_quality);
    progress.Add();
  });
  StopIfCancelled();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const FramePose& frame = frames[i];
    const std::string stamp = std::to_string(frame.timestamp_ns);
    list += stamp + Format(",images/%06zu.jpg\n", i);
    const Eigen::Matrix3d town_from_body =
        frame.town_from_cam.rotation.toRotationMatrix() * BodyFromCam().transpose();
    truth += stamp + "," +
             PoseColumns(town.geodesy(), frame.town_from_cam.translation, town_from_body) + "\n";
  }
  WriteText(drive / "frames.csv", list);
  WriteText(drive / "truth.csv", truth);
  WriteText(drive / "camera.yaml", ToCameraYaml(town.camera(), "town"));
}

void WriteSummary(const Town& town, const fs::path& directory) {
  WriteText(directory / "camera.yaml", ToCameraYaml(town.camera(), "town"));
  const World &map = town.world(Day::kMap), &drive = town.world(Day::kDrive);
  Json off_map = Json::array();
  for (const FramePose& frame : town.layout().frames) {
    if (frame.off_map) off_map.push_back(frame.timestamp_ns);
  }
  Json j;
  j["seed"] = town.options().seed;
  j["options"] = OptionsJson(town.options());
  j["made"] = {{"panoramas", town.layout().panoramas.size()},
               {"frames", town.layout().frames.size()},
               {"mapped_street_m", Rounded(town.layout().mapped_m, 3)},
               {"buildings", map.num_buildings},
               {"rebuilt", drive.num_rebuilt},
               {"trees", map.num_trees},
               {"cars_map", map.num_cars},
               {"cars_drive", drive.num_cars},
               {"people_map", map.num_people},
               {"people_drive", drive.num_people},
               {"quads", map.quads.size()}};
  j["off_map_timestamps_ns"] = off_map;
  WriteText(directory / "town.json", j.dump(1) + "\n");
}

void WriteTown(const Town& town, const fs::path& directory) {
  PrepareFolder(directory, town.options());
  if (town.options().write_panoramas) WritePanoramas(town, directory);
  if (town.options().write_drive) WriteDrive(town, directory);
  WriteSummary(town, directory);
}

}  // namespace panofix::town
