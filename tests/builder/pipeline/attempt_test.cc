#include "builder/pipeline/attempt.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <opencv2/imgcodecs.hpp>

#include "builder/pipeline/extract_stage.h"
#include "tests/common/features/synthetic_image.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

class AttemptTest : public testing::Test {
 protected:
  // A program that dies in the middle of it.
  void Die(const std::string& id, const std::string& key) const {
    const pid_t child = fork();
    if (child == 0) {
      const Attempt attempt(work_, Stage::kExtract, id, key);
      _exit(1);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
  }
  [[nodiscard]] bool IsSuspect(const std::string& id) const {
    return Attempt::IsSuspect(work_, Stage::kExtract, id);
  }
  TempFolder folder_;
  WorkFolder work_{folder_ / "work"};
};

TEST_F(AttemptTest, OneThatEndsWellLeavesNothing) {
  {
    const Attempt attempt(work_, Stage::kExtract, "a", "key");
    EXPECT_FALSE(attempt.IsHopeless());
    EXPECT_TRUE(IsSuspect("a"));
    EXPECT_FALSE(IsSuspect("b"));
  }
  EXPECT_FALSE(IsSuspect("a"));
}

TEST_F(AttemptTest, ThreeDeathsAreEnough) {
  for (int death = 0; death < kMostAttempts; ++death) {
    // One that lives through it clears the account.
    EXPECT_EQ(IsSuspect("a"), death > 0);
    Die("a", "key");
  }
  for (int again = 0; again < 2; ++again) {
    const Attempt attempt(work_, Stage::kExtract, "a", "key");
    EXPECT_TRUE(attempt.IsHopeless());
    EXPECT_NE(attempt.Reason().find("3 attempts"), std::string::npos);
  }
  EXPECT_FALSE(Attempt(work_, Stage::kExtract, "a", "mended").IsHopeless());
  EXPECT_FALSE(Attempt(work_, Stage::kAugment, "a", "key").IsHopeless());
}

TEST_F(AttemptTest, APanoramaThatKillsIsSetAsideAndTheOthersAreNot) {
  const GrayImage image = BusyImage(240, 120, 1);
  const cv::Mat view(image.height_px, image.width_px, CV_8UC1,
                     const_cast<std::uint8_t*>(image.pixels.data()));
  ASSERT_TRUE(cv::imwrite((folder_ / "p.png").string(), view));
  std::vector<PanoramaRecord> records(3);
  for (std::size_t i = 0; i < records.size(); ++i) {
    records[i].id = std::string(1, static_cast<char>('a' + i));
    records[i].image = folder_ / "p.png";
  }
  const Rectifier rectifier(Camera::FromHorizontalFov(60, 45, 80), RingOfViews(2, 0));
  const std::string bad = ContentKey(records[1], rectifier, {}).Hex();
  Die("a", ContentKey(records[0], rectifier, {}).Hex());  // stood beside it
  for (int death = 0; death < kMostAttempts; ++death) Die("b", bad);
  const ExtractStageResult result = ExtractStage(records, rectifier, {}, work_, nullptr);
  ASSERT_EQ(result.set_aside.size(), 1U);
  EXPECT_EQ(result.set_aside[0].id, "b");
  ASSERT_EQ(result.panoramas.size(), 2U);
  EXPECT_EQ(result.panoramas[0].record.id, "a");
  EXPECT_EQ(result.panoramas[1].record.id, "c");
  EXPECT_FALSE(IsSuspect("a"));
}

}  // namespace
}  // namespace panofix
