// The only includer of yaml-cpp: reads and writes the ROS camera_info layout.
#include <yaml-cpp/yaml.h>

#include <fstream>

#include "common/base/log.h"
#include "common/camera/camera.h"

namespace panofix {
namespace {

std::vector<double> Numbers(const YAML::Node& root, const char* key) {
  const YAML::Node node = root[key];
  if (!node)
    throw YAML::Exception(YAML::Mark::null_mark(), std::string("key '") + key + "' is missing");
  const YAML::Node data = node.IsMap() ? node["data"] : node;
  if (!data || !data.IsSequence()) {
    throw YAML::Exception(node.Mark(),
                          std::string("key '") + key + "' has no list of numbers in 'data'");
  }
  return data.as<std::vector<double>>();
}

template <typename T>
T Scalar(const YAML::Node& root, const char* key) {
  if (!root[key]) {
    throw YAML::Exception(YAML::Mark::null_mark(), std::string("key '") + key + "' is missing");
  }
  return root[key].as<T>();
}

Camera FromYaml(const YAML::Node& root) {
  if (!root.IsMap()) throw YAML::Exception(root.Mark(), "not a map of keys");
  Camera camera;
  camera.width_px = Scalar<int>(root, "image_width");
  camera.height_px = Scalar<int>(root, "image_height");
  const std::vector<double> K = Numbers(root, "camera_matrix");
  if (K.size() != 9)
    throw YAML::Exception(YAML::Mark::null_mark(), "key 'camera_matrix' needs 9 numbers");
  camera.fx_px = K[0], camera.cx_px = K[2], camera.fy_px = K[4], camera.cy_px = K[5];
  const auto model = Scalar<std::string>(root, "distortion_model");
  std::size_t most = 5;
  if (model == "rational_polynomial") {
    camera.distortion_model = DistortionModel::kRationalPolynomial;
    most = 8;
  } else if (model != "plumb_bob") {
    throw YAML::Exception(
        YAML::Mark::null_mark(),
        "distortion_model '" + model + "' is unknown; plumb_bob or rational_polynomial");
  }
  const std::vector<double> d = Numbers(root, "distortion_coefficients");
  if (d.size() < 4 || d.size() > most) {
    throw YAML::Exception(YAML::Mark::null_mark(),
                          Format("distortion_coefficients: %zu numbers; %s takes 4 to %zu",
                                 d.size(), model.c_str(), most));
  }
  std::copy(d.begin(), d.end(), camera.distortion.begin());
  return camera;
}

}  // namespace

Result<Camera> ParseCameraYaml(const std::string& text, const std::string& name) {
  constexpr const char* kMend = "; write it in the ROS camera_info layout";
  try {
    Camera camera = FromYaml(YAML::Load(text));
    const Status status = camera.Check();
    if (!status.ok()) return Status(ErrorCode::kBadData, name + ": " + status.message() + kMend);
    return camera;
  } catch (const YAML::Exception& error) {
    const std::string where = error.mark.is_null() ? "" : Format(" (line %d)", error.mark.line + 1);
    return Status(ErrorCode::kBadData, name + ": " + error.msg + where + kMend);
  }
}

Result<Camera> ReadCameraYaml(const std::filesystem::path& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    return Status(ErrorCode::kInvalidArgument,
                  path.string() + ": is a folder; name its camera.yaml");
  }
  std::ifstream file(path);
  if (!file) {
    return Status(ErrorCode::kNotFound,
                  path.string() + ": cannot be read; name an existing camera.yaml");
  }
  // A camera takes a few hundred bytes; whatever is larger is not read to its end.
  constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
  std::string text(kMaxBytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > kMaxBytes) {
    return Status(
        ErrorCode::kTooLarge,
        Format("%s: more than %zu bytes; name a camera.yaml in the ROS camera_info layout",
               path.c_str(), kMaxBytes));
  }
  return ParseCameraYaml(text, path.string());
}

std::string ToCameraYaml(const Camera& camera, const std::string& camera_name) {
  std::string d;
  const std::size_t count = camera.distortion_model == DistortionModel::kPlumbBob ? 5 : 8;
  for (std::size_t i = 0; i < count; ++i)
    d += Format(i ? ", %.17g" : "%.17g", camera.distortion[i]);
  return Format("image_width: %d\nimage_height: %d\ncamera_name: %s\n", camera.width_px,
                camera.height_px, camera_name.c_str()) +
         Format(
             "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [%.17g, 0, %.17g, 0, %.17g, %.17g, 0, "
             "0, 1]\n",
             camera.fx_px, camera.cx_px, camera.fy_px, camera.cy_px) +
         "distortion_model: " + DistortionModelName(camera.distortion_model) +
         Format("\ndistortion_coefficients:\n  rows: 1\n  cols: %zu\n  data: [", count) + d + "]\n";
}

}  // namespace panofix
