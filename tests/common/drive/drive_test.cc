#include "common/drive/drive.h"

#include <gtest/gtest.h>

#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTruthHeader =
    "timestamp_ns,latitude,longitude,altitude,heading,pitch,roll\n";

class DriveFolder : public testing::Test {
 protected:
  DriveFolder() {
    WriteText(folder_ / "camera.yaml", ToCameraYaml(Camera::FromHorizontalFov(640, 480, 70), "c"));
    WriteText(folder_ / "frames.csv", "timestamp_ns,image\n100,images/0.jpg\n200,images/1.jpg\n");
  }
  // The failure of reading the folder; empty code kOk where it reads.
  Status Fault() const { return ReadDrive(folder_.path()).status(); }
  void ExpectFault(ErrorCode code, const std::string& part) const {
    EXPECT_EQ(Fault().code(), code);
    EXPECT_NE(Fault().message().find(part), std::string::npos) << Fault().message();
  }
  TempFolder folder_;
};

TEST_F(DriveFolder, FramesCameraAndTruth) {
  std::string truth = kTruthHeader;
  truth += "100,48.8505986676,2.3348142763,40.254,179.38,4.2,-0.5\n";
  truth += "200,48.8505642811,2.3348102753,40.3136,,,\n";
  WriteText(folder_ / "truth.csv", truth);
  const auto drive = ReadDrive(folder_.path());
  ASSERT_TRUE(drive.ok()) << drive.status().message();
  ASSERT_EQ(drive->frames.size(), 2U);
  EXPECT_EQ(drive->frames[1].timestamp_ns, 200);
  EXPECT_EQ(drive->frames[1].image, folder_ / "images/1.jpg");
  EXPECT_EQ(drive->camera.width_px, 640);
  ASSERT_EQ(drive->truth.size(), 2U);
  EXPECT_EQ(drive->truth[0].position.lat_deg, 48.8505986676);
  EXPECT_EQ(drive->truth[0].position.lon_deg, 2.3348142763);
  EXPECT_EQ(drive->truth[0].position.height_m, 40.254);
  ASSERT_TRUE(drive->truth[0].attitude);
  EXPECT_EQ(drive->truth[0].attitude->heading_deg, 179.38);
  EXPECT_EQ(drive->truth[0].attitude->pitch_deg, 4.2);
  EXPECT_EQ(drive->truth[0].attitude->roll_deg, -0.5);
  EXPECT_FALSE(drive->truth[1].attitude);
}

TEST_F(DriveFolder, WithoutTruthAndWithWindowsLineEnds) {
  WriteText(folder_ / "frames.csv",
            "image,timestamp_ns,note\r\n\"a,b.jpg\",-5,x\r\n/abs/1.png,7,\r\n");
  const auto drive = ReadDrive(folder_.path());
  ASSERT_TRUE(drive.ok()) << drive.status().message();
  EXPECT_TRUE(drive->truth.empty());
  ASSERT_EQ(drive->frames.size(), 2U);
  EXPECT_EQ(drive->frames[0].timestamp_ns, -5);
  EXPECT_EQ(drive->frames[0].image, folder_ / "a,b.jpg");
  EXPECT_EQ(drive->frames[1].image, "/abs/1.png");
}

TEST_F(DriveFolder, WhatIsMissingIsNamed) {
  EXPECT_EQ(ReadDrive(folder_ / "absent").status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(ReadDrive(folder_ / "frames.csv").status().code(), ErrorCode::kNotFound);
  fs::remove(folder_ / "camera.yaml");
  ExpectFault(ErrorCode::kNotFound, "camera.yaml");
  fs::remove(folder_ / "frames.csv");
  ExpectFault(ErrorCode::kNotFound, "it needs a file with columns timestamp_ns,image");
}

TEST_F(DriveFolder, FaultyFramesNameTheLineAndTheMend) {
  WriteText(folder_ / "frames.csv", "timestamp_ns,image\n");
  ExpectFault(ErrorCode::kBadData, "frames.csv: holds no frame; write one row");
  WriteText(folder_ / "frames.csv", "");
  ExpectFault(ErrorCode::kBadData, "is empty; the header line needs");
  WriteText(folder_ / "frames.csv", "time,image\n1,a.jpg\n");
  ExpectFault(ErrorCode::kBadData, "column 'timestamp_ns' is missing");
  WriteText(folder_ / "frames.csv", "timestamp_ns,image\n1,a.jpg\n1.5,b.jpg\n");
  ExpectFault(ErrorCode::kBadData, "frames.csv:3: timestamp_ns '1.5' is not an integer");
  WriteText(folder_ / "frames.csv", "timestamp_ns,image\n1,\n");
  ExpectFault(ErrorCode::kBadData, "frames.csv:2: image is blank");
}

TEST_F(DriveFolder, FaultyTruthNamesTheLineAndTheMend) {
  const auto expect = [&](const std::string& row, const std::string& part) {
    WriteText(folder_ / "truth.csv", kTruthHeader + row + "\n");
    ExpectFault(ErrorCode::kBadData, part);
  };
  expect("1,north,2,3,,,", "truth.csv:2: latitude 'north' is not a finite number");
  expect("1,90.1,2,3,,,", "latitude '90.1' lies outside -90 to 90");
  expect("1,48,200,3,,,", "longitude '200' lies outside");
  expect("1,48,2,nan,,,", "altitude 'nan' is not a finite number");
  expect("1,48,2,,1,1,1", "altitude '' is not a finite number");
  expect("1,48,2,3,90,,0", "partly blank; fill in all three or none");
  expect("1,48,2,3,90,x,0", "pitch 'x'");
  expect("1,48,2,3,90,0", "6 fields where the header has 7");
}

TEST(Drive, ReadsTheEvaluationDrive) {
  const fs::path directory = fs::path(PANOFIX_EVALUATION_DATA) / "paris/drive_front";
  if (!fs::exists(directory)) GTEST_SKIP() << "no evaluation data at " << directory;
  const auto drive = ReadDrive(directory);
  ASSERT_TRUE(drive.ok()) << drive.status().message();
  EXPECT_FALSE(drive->frames.empty());
  EXPECT_EQ(drive->truth.size(), drive->frames.size());
  for (const DriveFrame& frame : drive->frames) EXPECT_TRUE(fs::exists(frame.image)) << frame.image;
}

}  // namespace
}  // namespace panofix
