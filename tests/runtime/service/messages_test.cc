// Round trips and conversions of well-formed messages.

#include "runtime/service/messages.h"

#include <gtest/gtest.h>

#include "schemas/CameraCalibration_generated.h"
#include "schemas/CompressedImage_generated.h"
#include "schemas/LocationFix_generated.h"
#include "schemas/RawImage_generated.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

constexpr std::int64_t kTimeNs = 1'712'345'678'901'234'567;
// Products of rotations and covariances: a few roundings of numbers below 1.
constexpr double kRounding = 1e-12;

WireBytes Wire(const std::vector<std::uint8_t>& bytes) { return WireBytes::Copy(bytes); }

TEST(Messages, CompressedFrameRoundTrip) {
  const auto jpeg = SampleJpeg();
  const auto frame = UnpackFrame(Wire(PackFrame(kTimeNs, jpeg)));
  ASSERT_TRUE(frame.ok()) << frame.status().message();
  EXPECT_EQ(frame->timestamp_ns, kTimeNs);
  EXPECT_EQ(frame->kind, FrameKind::kCompressed);
  EXPECT_EQ(frame->encoding, "jpeg");
  EXPECT_EQ(std::vector<std::uint8_t>(frame->data.begin(), frame->data.end()), jpeg);
  const auto gray = ConvertFrame(*frame);
  ASSERT_TRUE(gray.ok()) << gray.status().message();
  EXPECT_EQ(gray->pixels, ValueOrThrow(DecodeGray(jpeg)).pixels);
}

TEST(Messages, PngFrameIsExact) {
  const auto frame = UnpackFrame(Wire(PackFrame(kTimeNs, SamplePng(), "png")));
  ASSERT_TRUE(frame.ok());
  const auto gray = ConvertFrame(*frame);
  ASSERT_TRUE(gray.ok()) << gray.status().message();
  EXPECT_EQ(gray->pixels[10 * 64 + 7], 2 * 7 + 10);
}

TEST(Messages, RawGrayFrameRoundTrip) {
  const GrayImage image = SampleImage();
  const auto frame = UnpackFrame(Wire(PackRawFrame(kTimeNs, image)));
  ASSERT_TRUE(frame.ok());
  EXPECT_EQ(frame->kind, FrameKind::kRaw);
  const auto gray = ConvertFrame(*frame);
  ASSERT_TRUE(gray.ok()) << gray.status().message();
  EXPECT_EQ(gray->pixels, image.pixels);
  EXPECT_EQ(gray->width_px, image.width_px);
}

// Every corner of the colour cube against the weights of BT.601 in double precision.
TEST(Messages, ColourBecomesGreyByBt601) {
  constexpr double kIntegerWeights = 0.51;  // half a grey level, and the 15-bit weights' rounding
  std::vector<std::uint8_t> pixels;
  for (int i = 0; i < 64; ++i) {
    for (const int shift : {0, 2, 4})
      pixels.push_back(static_cast<std::uint8_t>(85 * (i >> shift & 3)));
  }
  for (const char* encoding : {"rgb8", "bgr8", "8UC3"}) {
    IncomingFrame frame{kTimeNs, FrameKind::kRaw, encoding, 64, 1, 192, {}, pixels};
    const auto gray = ConvertFrame(frame);
    ASSERT_TRUE(gray.ok());
    const int red = frame.encoding == "rgb8" ? 0 : 2;
    for (std::size_t i = 0; i < 64; ++i) {
      const double expected = 0.299 * pixels[3 * i + static_cast<std::size_t>(red)] +
                              0.587 * pixels[3 * i + 1] +
                              0.114 * pixels[3 * i + static_cast<std::size_t>(2 - red)];
      EXPECT_NEAR(gray->pixels[i], expected, kIntegerWeights) << encoding << " " << i;
    }
  }
}

TEST(Messages, RowPaddingIsIgnored) {
  const std::vector<std::uint8_t> data{1, 2, 99, 99, 3, 4};  // the last row lacks its padding
  const IncomingFrame frame{kTimeNs, FrameKind::kRaw, "mono8", 2, 2, 4, {}, data};
  const auto gray = ConvertFrame(frame);
  ASSERT_TRUE(gray.ok()) << gray.status().message();
  EXPECT_EQ(gray->pixels, (std::vector<std::uint8_t>{1, 2, 3, 4}));
}

TEST(Messages, CalibrationRoundTrip) {
  Camera camera = SampleCamera();
  camera.fx_px = 812.125, camera.cy_px = 301.0625;
  camera.distortion = {-0.3, 0.1, 1e-3, -2e-3, 0.05, 0, 0, 0};
  for (const auto model : {DistortionModel::kPlumbBob, DistortionModel::kRationalPolynomial}) {
    camera.distortion_model = model;
    if (model == DistortionModel::kRationalPolynomial) camera.distortion[7] = 0.25;
    const auto back = UnpackCalibration(Wire(PackCalibration(kTimeNs, camera)));
    ASSERT_TRUE(back.ok()) << back.status().message();
    EXPECT_EQ(back->width_px, camera.width_px);
    EXPECT_EQ(back->height_px, camera.height_px);
    EXPECT_EQ(back->Matrix(), camera.Matrix());
    EXPECT_EQ(back->distortion, camera.distortion);
    EXPECT_EQ(back->distortion_model, model);
  }
}

TEST(Messages, FixRoundTrip) {
  const FrameResult fix = SampleFix(kTimeNs);
  BundleIdentity bundle = SampleBundle();
  bundle.is_signed = true;
  const auto back = UnpackResult(Wire(PackResult(fix, bundle, 2.5)));
  ASSERT_TRUE(back.ok()) << back.status().message();
  EXPECT_EQ(back->row.timestamp_ns, kTimeNs);
  EXPECT_EQ(back->row.status, FixStatus::kFix);
  EXPECT_EQ(back->row.num_inliers, fix.num_inliers);
  EXPECT_EQ(back->row.num_views, fix.num_views);
  EXPECT_EQ(back->row.best_panorama, fix.best_panorama);
  EXPECT_EQ(back->row.latency_ms, fix.latency.total_ms + 2.5);
  EXPECT_EQ(back->decode_ms, 2.5);
  EXPECT_EQ(back->result.latency.matching_ms, fix.latency.matching_ms);
  EXPECT_EQ(back->result.num_compared, fix.num_compared);
  EXPECT_EQ(back->result.num_database, fix.num_database);
  EXPECT_EQ(back->bundle.name, bundle.name);
  EXPECT_EQ(back->bundle.id, bundle.id);
  EXPECT_EQ(back->bundle.build, bundle.build);
  EXPECT_TRUE(back->bundle.is_signed);
  ASSERT_TRUE(back->row.pose && back->result.pose);
  EXPECT_EQ(back->row.pose->position.lat_deg, fix.pose->position.lat_deg);
  EXPECT_EQ(back->row.pose->position.lon_deg, fix.pose->position.lon_deg);
  EXPECT_EQ(back->row.pose->position.height_m, fix.pose->position.height_m);
  EXPECT_EQ(back->row.pose->attitude.heading_deg, fix.pose->attitude.heading_deg);
  EXPECT_EQ(back->row.pose->attitude.pitch_deg, fix.pose->attitude.pitch_deg);
  EXPECT_EQ(back->row.pose->attitude.roll_deg, fix.pose->attitude.roll_deg);
  EXPECT_EQ(back->row.pose->enu_from_cam.coeffs(), fix.pose->enu_from_cam.coeffs());
  EXPECT_EQ(back->result.pose->position_in_map, fix.pose->position_in_map);
  EXPECT_EQ(back->result.pose->map_from_cam.coeffs(), fix.pose->map_from_cam.coeffs());
  EXPECT_EQ(back->result.pose->covariance_in_map, fix.pose->covariance_in_map);
}

TEST(Messages, NoFixRoundTrip) {
  const FrameResult no_fix = SampleNoFix(kTimeNs);
  const auto back = UnpackResult(Wire(PackResult(no_fix, SampleBundle())));
  ASSERT_TRUE(back.ok()) << back.status().message();
  EXPECT_EQ(back->row.status, FixStatus::kNoFix);
  EXPECT_EQ(back->row.reason, no_fix.reason);
  EXPECT_FALSE(back->row.pose.has_value());
  EXPECT_FALSE(back->result.pose.has_value());
  EXPECT_FALSE(back->bundle.is_signed);
}

// The map's axes stand 0.3 rad off: the closed form of a covariance turned about the vertical.
TEST(Messages, SigmasAreAlongEastNorthUp) {
  FramePose pose = SamplePose();
  pose.covariance_in_map.setZero();
  pose.covariance_in_map.diagonal() << 4, 1, 9, 0.01, 0.02, 0.0004;
  const PoseSigmas sigma = SigmasOf(pose);
  const double c2 = std::cos(0.3) * std::cos(0.3), s2 = 1 - c2;
  EXPECT_NEAR(sigma.east_m, std::sqrt(4 * c2 + 1 * s2), kRounding);
  EXPECT_NEAR(sigma.north_m, std::sqrt(4 * s2 + 1 * c2), kRounding);
  EXPECT_NEAR(sigma.up_m, 3, kRounding);
  EXPECT_NEAR(sigma.heading_deg, 0.02 * 180 / M_PI, kRounding);
}

TEST(Messages, LocationFixSaysWhatTheResultSays) {
  const FrameResult fix = SampleFix(kTimeNs);
  const auto bytes = PackLocationFix(fix, SampleBundle());
  flatbuffers::Verifier verifier(bytes.data(), bytes.size());
  ASSERT_TRUE(foxglove::VerifyLocationFixBuffer(verifier));
  const foxglove::LocationFix* message = foxglove::GetLocationFix(bytes.data());
  EXPECT_EQ(message->timestamp()->sec(), kTimeNs / 1'000'000'000);
  EXPECT_EQ(message->timestamp()->nsec(), kTimeNs % 1'000'000'000);
  EXPECT_EQ(message->latitude(), fix.pose->position.lat_deg);
  EXPECT_EQ(message->longitude(), fix.pose->position.lon_deg);
  EXPECT_EQ(message->altitude(), fix.pose->position.height_m);
  EXPECT_NEAR(message->heading().value_or(-1), 123.5 * M_PI / 180, kRounding);
  ASSERT_EQ(message->position_covariance()->size(), 9U);
  const PoseSigmas sigma = SigmasOf(*fix.pose);
  EXPECT_NEAR(message->position_covariance()->Get(0), sigma.east_m * sigma.east_m, kRounding);
  EXPECT_NEAR(message->position_covariance()->Get(4), sigma.north_m * sigma.north_m, kRounding);
  EXPECT_NEAR(message->position_covariance()->Get(1), message->position_covariance()->Get(3),
              kRounding);
  EXPECT_EQ(message->metadata()->Get(0)->value()->str(), "fix");
}

TEST(Messages, TimesOfTheWire) {
  EXPECT_TRUE(FitsWireTime(0));
  EXPECT_TRUE(FitsWireTime(4'294'967'295'999'999'999));
  EXPECT_FALSE(FitsWireTime(4'294'967'296'000'000'000));
  EXPECT_FALSE(FitsWireTime(-1));
  EXPECT_THROW(PackFrame(-1, SampleJpeg()), std::logic_error);
}

// Field places in Foxglove's published schemas: a reader built from those must find ours.
TEST(Schemas, FieldIdsAreFoxgloves) {
  const auto place = [](int id) { return 4 + 2 * id; };
  using Compressed = foxglove::CompressedImage;
  EXPECT_EQ(Compressed::VT_TIMESTAMP, place(0));
  EXPECT_EQ(Compressed::VT_DATA, place(2));
  EXPECT_EQ(Compressed::VT_FORMAT, place(3));
  using Raw = foxglove::RawImage;
  EXPECT_EQ(Raw::VT_WIDTH, place(2));
  EXPECT_EQ(Raw::VT_ENCODING, place(4));
  EXPECT_EQ(Raw::VT_STEP, place(5));
  EXPECT_EQ(Raw::VT_DATA, place(6));
  using Calibration = foxglove::CameraCalibration;
  EXPECT_EQ(Calibration::VT_DISTORTION_MODEL, place(4));
  EXPECT_EQ(Calibration::VT_D, place(5));
  EXPECT_EQ(Calibration::VT_K, place(6));
  EXPECT_EQ(Calibration::VT_P, place(8));
  using Fix = foxglove::LocationFix;
  EXPECT_EQ(Fix::VT_LATITUDE, place(2));
  EXPECT_EQ(Fix::VT_POSITION_COVARIANCE, place(5));
  EXPECT_EQ(Fix::VT_COLOR, place(7));
  EXPECT_EQ(Fix::VT_METADATA, place(8));
  EXPECT_EQ(Fix::VT_HEADING, place(9));
  EXPECT_EQ(Fix::VT_VELOCITY, place(10));
}

}  // namespace
}  // namespace panofix
