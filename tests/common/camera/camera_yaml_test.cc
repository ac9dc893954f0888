#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "common/camera/camera.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

const std::string kGood =
    "image_width: 640\n"
    "image_height: 480\n"
    "camera_name: front\n"
    "camera_matrix:\n"
    "  rows: 3\n"
    "  cols: 3\n"
    "  data: [520.5, 0, 322, 0, 515, 236, 0, 0, 1]\n"
    "distortion_model: plumb_bob\n"
    "distortion_coefficients:\n"
    "  rows: 1\n"
    "  cols: 5\n"
    "  data: [-0.28, 0.09, 0.0012, -0.0007, 0]\n"
    "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n";

std::string With(const std::string& old_text, const std::string& new_text) {
  std::string text = kGood;
  const std::size_t at = text.find(old_text);
  EXPECT_NE(at, std::string::npos) << old_text;
  return text.replace(at, old_text.size(), new_text);
}

// The failure names the file and holds every word of `words`.
void ExpectRefused(const std::string& text, const std::vector<std::string>& words) {
  const auto camera = ParseCameraYaml(text, "cam.yaml");
  ASSERT_FALSE(camera.ok()) << text;
  EXPECT_EQ(camera.status().code(), ErrorCode::kBadData);
  const std::string message = camera.status().message();
  EXPECT_EQ(message.substr(0, 10), "cam.yaml: ");
  EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  for (const std::string& word : words) {
    EXPECT_NE(message.find(word), std::string::npos) << message << " lacks " << word;
  }
}

TEST(ParseCameraYaml, ReadsTheRosLayout) {
  const auto camera = ParseCameraYaml(kGood, "cam.yaml");
  ASSERT_TRUE(camera.ok()) << camera.status().message();
  EXPECT_EQ(camera->width_px, 640);
  EXPECT_EQ(camera->height_px, 480);
  EXPECT_EQ(camera->fx_px, 520.5);
  EXPECT_EQ(camera->fy_px, 515.0);
  EXPECT_EQ(camera->cx_px, 322.0);
  EXPECT_EQ(camera->cy_px, 236.0);
  EXPECT_EQ(camera->distortion_model, DistortionModel::kPlumbBob);
  EXPECT_EQ(camera->distortion, (std::array<double, 8>{-0.28, 0.09, 0.0012, -0.0007, 0, 0, 0, 0}));
}

TEST(ParseCameraYaml, ReadsRationalPolynomial) {
  std::string text = With("plumb_bob", "rational_polynomial");
  text.replace(text.find("-0.0007, 0]"), 11, "-0.0007, 0.1, 0.2, 0.3, 0.4]");
  const auto camera = ParseCameraYaml(text, "cam.yaml");
  ASSERT_TRUE(camera.ok()) << camera.status().message();
  EXPECT_EQ(camera->distortion_model, DistortionModel::kRationalPolynomial);
  EXPECT_EQ(camera->distortion[7], 0.4);
}

TEST(ParseCameraYaml, TakesAPlainListToo) {
  const auto camera = ParseCameraYaml(
      "{image_width: 64, image_height: 48, distortion_model: plumb_bob,\n"
      " camera_matrix: [50, 0, 31.5, 0, 50, 23.5, 0, 0, 1], distortion_coefficients: [0, 0, 0, 0]}",
      "cam.yaml");
  ASSERT_TRUE(camera.ok()) << camera.status().message();
  EXPECT_FALSE(camera->HasDistortion());
}

TEST(ParseCameraYaml, RoundTripKeepsEveryBit) {
  Camera camera;
  camera.width_px = 1280, camera.height_px = 720;
  camera.fx_px = 1000.0 / 3, camera.fy_px = 333.1234567890123;
  camera.cx_px = 639.5 + 1e-13, camera.cy_px = 359.4999999999999;
  for (const auto model : {DistortionModel::kPlumbBob, DistortionModel::kRationalPolynomial}) {
    camera.distortion_model = model;
    camera.distortion = {-0.1, 1.0 / 7, 1e-17, -2e-300, 0.3, 0, 0, 0};
    if (model == DistortionModel::kRationalPolynomial) camera.distortion[7] = 1.0 / 9;
    const auto back = ParseCameraYaml(ToCameraYaml(camera, "front"), "x");
    ASSERT_TRUE(back.ok()) << back.status().message();
    EXPECT_EQ(back->Matrix(), camera.Matrix());
    EXPECT_EQ(back->distortion, camera.distortion);
    EXPECT_EQ(back->distortion_model, model);
    EXPECT_EQ(back->width_px, 1280);
    EXPECT_EQ(back->height_px, 720);
  }
}

TEST(ParseCameraYaml, MissingKeysAreNamed) {
  for (const std::string key : {"image_width", "image_height", "camera_matrix", "distortion_model",
                                "distortion_coefficients"}) {
    ExpectRefused(With(key, "other_key"), {key, "missing", "ROS camera_info"});
  }
}

TEST(ParseCameraYaml, UnknownDistortionModelIsRefused) {
  ExpectRefused(With("plumb_bob", "equidistant"),
                {"equidistant", "plumb_bob", "rational_polynomial"});
}

TEST(ParseCameraYaml, WrongCountsAreRefused) {
  ExpectRefused(With("[520.5, 0, 322, 0, 515, 236, 0, 0, 1]", "[520.5, 515]"),
                {"camera_matrix", "9"});
  ExpectRefused(With("[-0.28, 0.09, 0.0012, -0.0007, 0]", "[1, 2, 3]"),
                {"distortion_coefficients", "3 numbers"});
  ExpectRefused(With("[-0.28, 0.09, 0.0012, -0.0007, 0]", "[1, 2, 3, 4, 5, 6]"),
                {"distortion_coefficients", "plumb_bob"});
  ExpectRefused(With("[-0.28, 0.09, 0.0012, -0.0007, 0]", "5"),
                {"distortion_coefficients", "data"});
}

TEST(ParseCameraYaml, NumbersOutOfRangeAreRefused) {
  ExpectRefused(With("520.5", ".nan"), {"camera_matrix"});
  ExpectRefused(With("322", ".inf"), {"camera_matrix"});
  ExpectRefused(With("520.5", "0"), {"focal"});
  ExpectRefused(With("520.5", "-520.5"), {"focal"});
  ExpectRefused(With("0.0012", "-.inf"), {"distortion_coefficients"});
  ExpectRefused(With("640", "-640"), {"image size"});
  ExpectRefused(With("640", "99999"), {"image size"});
  ExpectRefused(With("640", "99999999999999999999"), {});
  ExpectRefused(With("640", "wide"), {});
  ExpectRefused(With("520.5", "long"), {});
}

TEST(ParseCameraYaml, TextThatIsNoMapIsRefused) {
  for (const std::string text :
       {"", "\n", "just words", "[1, 2]", "a: [", "{a: b", "\t:\t:", "- - -"}) {
    ExpectRefused(text, {});
  }
  ExpectRefused(std::string(100000, '['), {});
  ExpectRefused(std::string("a\0b", 3), {});
}

TEST(ReadCameraYaml, ReadsAFile) {
  const TempFolder folder;
  WriteText(folder / "camera.yaml", kGood);
  const auto camera = ReadCameraYaml(folder / "camera.yaml");
  ASSERT_TRUE(camera.ok()) << camera.status().message();
  EXPECT_EQ(camera->width_px, 640);
}

TEST(ReadCameraYaml, NamesAFileThatIsNotThereOrNotAFile) {
  const TempFolder folder;
  const auto missing = ReadCameraYaml(folder / "none.yaml");
  EXPECT_EQ(missing.status().code(), ErrorCode::kNotFound);
  EXPECT_NE(missing.status().message().find("none.yaml"), std::string::npos);
  EXPECT_FALSE(ReadCameraYaml(folder.path()).ok());
}

TEST(ReadCameraYaml, RefusesAFileThatCannotBeACamera) {
  const TempFolder folder;
  WriteText(folder / "camera.yaml", kGood + std::string(std::size_t{2} << 20, '#'));
  EXPECT_EQ(ReadCameraYaml(folder / "camera.yaml").status().code(), ErrorCode::kTooLarge);
}

}  // namespace
}  // namespace panofix
