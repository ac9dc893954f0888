// Payloads that a broken or hostile peer could send.

#include <flatbuffers/flatbuffers.h>
#include <gtest/gtest.h>

#include <limits>

#include "common/base/rng.h"
#include "runtime/service/messages.h"
#include "schemas/CameraCalibration_generated.h"
#include "schemas/CompressedImage_generated.h"
#include "schemas/LocalizationResult_generated.h"
#include "schemas/RawImage_generated.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

constexpr std::int64_t kTimeNs = 1'712'345'678'901'234'567;

using Bytes = std::vector<std::uint8_t>;
Bytes Finished(const flatbuffers::FlatBufferBuilder& builder) {
  return {builder.GetBufferPointer(), builder.GetBufferPointer() + builder.GetSize()};
}

// Runs every reader over the bytes, as far as each goes.
int NumAccepted(const Bytes& bytes) {
  const WireBytes payload = WireBytes::Copy(bytes);
  int num_accepted = 0;
  const auto frame = UnpackFrame(payload);
  DecodeLimits limits;
  limits.max_pixels = 1'000'000;
  if (frame.ok() && ConvertFrame(*frame, limits).ok()) ++num_accepted;
  if (UnpackCalibration(payload).ok()) ++num_accepted;
  if (UnpackResult(payload).ok()) ++num_accepted;
  return num_accepted;
}

std::vector<Bytes> Samples() {
  return {PackFrame(kTimeNs, SamplePng(), "png"), PackRawFrame(kTimeNs, SampleImage(16, 16)),
          PackCalibration(kTimeNs, SampleCamera()), PackResult(SampleFix(kTimeNs), SampleBundle()),
          PackResult(SampleNoFix(kTimeNs), SampleBundle())};
}

TEST(HostileMessages, EveryStartAddressIsRead) {
  for (const Bytes& sample : Samples()) {
    for (std::size_t shift = 0; shift < 8; ++shift) {
      Bytes storage(sample.size() + shift);
      std::copy(sample.begin(), sample.end(), storage.begin() + static_cast<std::ptrdiff_t>(shift));
      const WireBytes payload{nullptr, std::span(storage).subspan(shift)};
      const auto frame = UnpackFrame(payload);
      EXPECT_EQ((frame.ok() && ConvertFrame(*frame).ok()) + UnpackCalibration(payload).ok() +
                    UnpackResult(payload).ok(),
                1)
          << shift;
    }
  }
}

TEST(HostileMessages, CutShortIsRefused) {
  // A builder may pad the front only, so that every byte of the end counts.
  for (const Bytes& sample : Samples()) {
    for (std::size_t size = 0; size < sample.size(); size += 1 + size / 64) {
      const Bytes cut(sample.begin(), sample.begin() + static_cast<std::ptrdiff_t>(size));
      EXPECT_EQ(NumAccepted(cut), 0) << size << " of " << sample.size();
    }
  }
}

TEST(HostileMessages, ForeignIdentifierIsRefused) {
  for (Bytes sample : Samples()) {
    sample[4] = 'X';
    EXPECT_EQ(NumAccepted(sample), 0);
  }
}

// Under the sanitizers this is the proof that nothing is read outside the payload.
TEST(HostileMessages, MutationsNeverCrash) {
  const std::vector<Bytes> samples = Samples();
  Rng rng(20240521, "service/mutations");
  int num_accepted = 0;
  for (int i = 0; i < 20'000; ++i) {
    Bytes bytes = samples[rng.Below(samples.size())];
    const std::uint64_t num_changes = 1 + rng.Below(4);
    for (std::uint64_t change = 0; change < num_changes; ++change) {
      // Half of the changes hit the tables and offsets at the front.
      const std::uint64_t bound =
          rng.Below(2) == 0 ? std::min<std::size_t>(bytes.size(), 96) : bytes.size();
      bytes[rng.Below(bound)] = static_cast<std::uint8_t>(rng());
    }
    if (rng.Below(8) == 0) bytes.resize(rng.Below(bytes.size() + 1));
    num_accepted += NumAccepted(bytes);
  }
  // Pixels, names and coordinates may change and the message still be one; lengths may not.
  EXPECT_GT(num_accepted, 0);
  EXPECT_LT(num_accepted, 20'000);
}

TEST(HostileMessages, RandomBytesAreRefused) {
  Rng rng(7, "service/random");
  for (int i = 0; i < 2'000; ++i) {
    Bytes bytes(rng.Below(300));
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(rng());
    EXPECT_EQ(NumAccepted(bytes), 0);
  }
}

TEST(HostileMessages, FrameWithoutTimestampIsRefused) {
  flatbuffers::FlatBufferBuilder builder;
  foxglove::FinishCompressedImageBuffer(builder, foxglove::CreateCompressedImage(builder));
  const auto frame = UnpackFrame(WireBytes::Copy(Finished(builder)));
  ASSERT_FALSE(frame.ok());
  EXPECT_EQ(frame.status().code(), ErrorCode::kBadData);
  EXPECT_NE(frame.status().message().find("timestamp"), std::string::npos);
}

TEST(HostileMessages, NanosecondsAboveASecondAreRefused) {
  flatbuffers::FlatBufferBuilder builder;
  const foxglove::Time time(1, 1'000'000'000);
  foxglove::FinishCompressedImageBuffer(builder, foxglove::CreateCompressedImage(builder, &time));
  EXPECT_FALSE(UnpackFrame(WireBytes::Copy(Finished(builder))).ok());
}

TEST(HostileMessages, FrameWithoutPixelsKeepsItsTime) {
  flatbuffers::FlatBufferBuilder builder;
  const foxglove::Time time(5, 6);
  foxglove::FinishRawImageBuffer(builder, foxglove::CreateRawImage(builder, &time));
  const auto frame = UnpackFrame(WireBytes::Copy(Finished(builder)));
  ASSERT_TRUE(frame.ok());
  EXPECT_EQ(frame->timestamp_ns, 5'000'000'006);
  EXPECT_FALSE(ConvertFrame(*frame).ok());
}

TEST(HostileMessages, CompressedFrameThatDoesNotDecode) {
  Bytes jpeg = SampleJpeg();
  const auto code = [](const Bytes& bytes, const std::string& format) {
    const auto frame = UnpackFrame(WireBytes::Copy(PackFrame(kTimeNs, bytes, format)));
    return ConvertFrame(ValueOrThrow(frame)).status().code();
  };
  EXPECT_EQ(code(jpeg, "webp"), ErrorCode::kBadData);
  EXPECT_EQ(code({}, "jpeg"), ErrorCode::kBadData);
  EXPECT_EQ(code({1, 2, 3}, "jpeg"), ErrorCode::kBadData);
  jpeg.resize(jpeg.size() / 2);
  EXPECT_EQ(code(jpeg, "jpeg"), ErrorCode::kBadData);
}

TEST(HostileMessages, RawFrameThatDoesNotFit) {
  const Bytes data(300);
  const auto code = [&data](const char* encoding, std::uint32_t width, std::uint32_t height,
                            std::uint32_t step) {
    return ConvertFrame({kTimeNs, FrameKind::kRaw, encoding, width, height, step, {}, data})
        .status()
        .code();
  };
  constexpr std::uint32_t kMax = std::numeric_limits<std::uint32_t>::max();
  EXPECT_EQ(code("mono8", 10, 30, 10), ErrorCode::kOk);
  EXPECT_EQ(code("mono8", 10, 31, 10), ErrorCode::kBadData);
  EXPECT_EQ(code("bgr8", 10, 10, 29), ErrorCode::kBadData);
  EXPECT_EQ(code("bgr8", 10, 10, 0), ErrorCode::kBadData);
  EXPECT_EQ(code("yuv422", 10, 10, 20), ErrorCode::kBadData);
  EXPECT_EQ(code("mono8", 0, 10, 10), ErrorCode::kBadData);
  EXPECT_EQ(code("mono8", kMax, kMax, kMax), ErrorCode::kTooLarge);
  EXPECT_EQ(code("mono8", 1, 2, kMax), ErrorCode::kBadData);
  EXPECT_EQ(code("mono8", 1, 400'000'000, kMax), ErrorCode::kBadData);
}

struct CalibrationFields {
  std::uint32_t width = 640, height = 480;
  std::string model = "plumb_bob";
  std::vector<double> d{0, 0, 0, 0, 0}, k{500, 0, 320, 0, 500, 240, 0, 0, 1};
};

Result<Camera> Unpacked(const CalibrationFields& fields) {
  flatbuffers::FlatBufferBuilder builder;
  const auto model = builder.CreateString(fields.model);
  const auto d = builder.CreateVector(fields.d);
  const auto k = builder.CreateVector(fields.k);
  foxglove::FinishCameraCalibrationBuffer(
      builder, foxglove::CreateCameraCalibration(builder, nullptr, 0, fields.width, fields.height,
                                                 model, d, k));
  return UnpackCalibration(WireBytes::Copy(Finished(builder)));
}

TEST(HostileMessages, CalibrationsThatAreNone) {
  EXPECT_TRUE(Unpacked({}).ok());
  EXPECT_TRUE(Unpacked({.d = {}}).ok());
  EXPECT_TRUE(Unpacked({.d = {0.1, 0, 0, 0}}).ok());
  EXPECT_FALSE(Unpacked({.width = 0}).ok());
  EXPECT_FALSE(Unpacked({.width = 0xffffffff}).ok());
  EXPECT_FALSE(Unpacked({.model = "kannala_brandt", .d = {0, 0, 0, 0}}).ok());
  EXPECT_FALSE(Unpacked({.d = {0, 0, 0}}).ok());
  EXPECT_FALSE(Unpacked({.d = std::vector<double>(9)}).ok());
  EXPECT_FALSE(Unpacked({.d = {0, 0, 0, 0, std::nan("")}}).ok());
  EXPECT_FALSE(Unpacked({.k = {}}).ok());
  EXPECT_FALSE(Unpacked({.k = {0, 0, 0, 0, 0, 0, 0, 0, 1}}).ok());          // not calibrated
  EXPECT_FALSE(Unpacked({.k = {500, 3, 320, 0, 500, 240, 0, 0, 1}}).ok());  // skewed
  EXPECT_FALSE(Unpacked({.k = {500, 0, 320, 0, -500, 240, 0, 0, 1}}).ok());
  EXPECT_FALSE(Unpacked({.k = {500, 0, 320, 0, INFINITY, 240, 0, 0, 1}}).ok());
}

TEST(HostileMessages, ResultsThatWouldMislead) {
  const auto refused = [](const FrameResult& result) {
    return !UnpackResult(WireBytes::Copy(PackResult(result, SampleBundle()))).ok();
  };
  FrameResult result = SampleFix(kTimeNs);
  EXPECT_FALSE(refused(result));
  result.pose->position.lat_deg = 91;
  EXPECT_TRUE(refused(result));
  result = SampleFix(kTimeNs), result.pose->position.lon_deg = std::nan("");
  EXPECT_TRUE(refused(result));
  result = SampleFix(kTimeNs), result.pose->covariance_in_map(2, 3) = INFINITY;
  EXPECT_TRUE(refused(result));
  result = SampleFix(kTimeNs), result.pose->map_from_cam.coeffs() *= 2;
  EXPECT_TRUE(refused(result));
  result = SampleFix(kTimeNs), result.pose.reset();
  EXPECT_TRUE(refused(result));
  result = SampleFix(kTimeNs), result.status = FixStatus::kNoFix;
  EXPECT_TRUE(refused(result));
  result = SampleNoFix(kTimeNs), result.num_inliers = -1;
  EXPECT_TRUE(refused(result));
  result = SampleNoFix(kTimeNs), result.reason = "line\nbreak";
  EXPECT_TRUE(refused(result));
  result = SampleNoFix(kTimeNs), result.best_panorama.assign(2000, 'x');
  EXPECT_TRUE(refused(result));
}

TEST(HostileMessages, StatusOfANewerVersionIsRefused) {
  flatbuffers::FlatBufferBuilder builder;
  const foxglove::Time time(5, 6);
  wire::LocalizationResultBuilder result(builder);
  result.add_timestamp(&time);
  result.add_status(static_cast<wire::FixStatus>(9));
  wire::FinishLocalizationResultBuffer(builder, result.Finish());
  EXPECT_FALSE(UnpackResult(WireBytes::Copy(Finished(builder))).ok());
}

}  // namespace
}  // namespace panofix
