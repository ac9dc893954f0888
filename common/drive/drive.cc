#include "common/drive/drive.h"

#include "common/drive/csv.h"

namespace panofix {
namespace {

constexpr double kMaxHeightM = 1e5;
constexpr double kMaxAngleDeg = 1e4;

Result<std::vector<DriveFrame>> ReadFrames(const std::filesystem::path& directory) {
  const std::filesystem::path path = directory / "frames.csv";
  Result<CsvReader> table = CsvReader::Open(path, {"timestamp_ns", "image"});
  if (!table.ok()) return table.status();
  std::vector<DriveFrame> frames;
  while (true) {
    const Result<bool> more = table->Next();
    if (!more.ok()) return more.status();
    if (!*more) break;
    const Result<std::int64_t> timestamp_ns = table->Integer(0);
    if (!timestamp_ns.ok()) return timestamp_ns.status();
    if (table->IsBlank(1)) return table->Bad("image is blank", "name the frame's image file");
    frames.push_back(
        {*timestamp_ns, directory / table->Text(1)});  // an absolute image stays itself
  }
  if (frames.empty()) {
    return Status(ErrorCode::kBadData,
                  path.string() + ": holds no frame; write one row a recorded image");
  }
  return frames;
}

Result<TruthPose> TruthRow(const CsvReader& table) {
  TruthPose pose;
  const Result<std::int64_t> timestamp_ns = table.Integer(0);
  if (!timestamp_ns.ok()) return timestamp_ns.status();
  pose.timestamp_ns = *timestamp_ns;
  double* const position[] = {&pose.position.lat_deg, &pose.position.lon_deg,
                              &pose.position.height_m};
  const double limits[] = {90, 180, kMaxHeightM};
  for (std::size_t i = 0; i < 3; ++i) {
    const Result<double> value = table.Number(1 + i, -limits[i], limits[i]);
    if (!value.ok()) return value.status();
    *position[i] = *value;
  }
  const int num_blank = table.IsBlank(4) + table.IsBlank(5) + table.IsBlank(6);
  if (num_blank == 3) return pose;
  if (num_blank != 0) {
    return table.Bad("heading, pitch and roll are partly blank", "fill in all three or none");
  }
  Attitude attitude;
  double* const angles[] = {&attitude.heading_deg, &attitude.pitch_deg, &attitude.roll_deg};
  for (std::size_t i = 0; i < 3; ++i) {
    const Result<double> value = table.Number(4 + i, -kMaxAngleDeg, kMaxAngleDeg);
    if (!value.ok()) return value.status();
    *angles[i] = *value;
  }
  pose.attitude = attitude;
  return pose;
}

Result<std::vector<TruthPose>> ReadTruth(const std::filesystem::path& path) {
  Result<CsvReader> table = CsvReader::Open(
      path, {"timestamp_ns", "latitude", "longitude", "altitude", "heading", "pitch", "roll"});
  if (!table.ok()) return table.status();
  std::vector<TruthPose> truth;
  while (true) {
    const Result<bool> more = table->Next();
    if (!more.ok()) return more.status();
    if (!*more) return truth;
    const Result<TruthPose> pose = TruthRow(*table);
    if (!pose.ok()) return pose.status();
    truth.push_back(*pose);
  }
}

}  // namespace

Result<Drive> ReadDrive(const std::filesystem::path& directory) {
  std::error_code error;
  if (!std::filesystem::is_directory(directory, error)) {
    return Status(
        ErrorCode::kNotFound,
        directory.string() + ": no such folder; name one that holds frames.csv and camera.yaml");
  }
  Drive drive;
  Result<std::vector<DriveFrame>> frames = ReadFrames(directory);
  if (!frames.ok()) return frames.status();
  drive.frames = std::move(frames).value();
  const Result<Camera> camera = ReadCameraYaml(directory / "camera.yaml");
  if (!camera.ok()) return camera.status();
  drive.camera = *camera;
  const std::filesystem::path truth_path = directory / "truth.csv";
  if (std::filesystem::exists(truth_path, error)) {
    Result<std::vector<TruthPose>> truth = ReadTruth(truth_path);
    if (!truth.ok()) return truth.status();
    drive.truth = std::move(truth).value();
  }
  return drive;
}

}  // namespace panofix
