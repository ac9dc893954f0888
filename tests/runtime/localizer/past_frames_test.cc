#include "runtime/localizer/past_frames.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr double kExact_m = 1e-9, kExact_rad = 1e-7;  // the angle of near-equal turns rounds

class PastFramesTest : public testing::Test {
 protected:
  PastFramesTest() {
    SmallBundle().Write(folder_ / "map");
    auto opened = MapBundle::Open(folder_ / "map");
    EXPECT_TRUE(opened.ok()) << opened.status().message();
    if (opened.ok()) bundle_ = std::move(opened).value();
  }
  [[nodiscard]] static Rigid3 At(double x_m) {
    return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(x_m, 0, 0)};
  }
  [[nodiscard]] std::size_t NumFrames(const PastFrames& past) const {
    return past.InLocal(*bundle_, LocalFrame::At(bundle_->panoramas()[0])).size();
  }
  TempFolder folder_;
  std::shared_ptr<const MapBundle> bundle_;
};

TEST_F(PastFramesTest, AppearInTheLocalFrameOfTheFrameAtHand) {
  ASSERT_TRUE(bundle_);
  const Rigid3 map_from_cam(
      Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized())),
      bundle_->panoramas()[1].map_from_pano.translation + Eigen::Vector3d(2, -1, 0.5));
  Correspondence match;
  match.panorama_idx = 2;
  match.lever_in_map = {3, 4, 5};
  match.point_in_map.setConstant(12345);  // of another local frame: not to be used
  PastFrames past;
  past.Add(0, map_from_cam, {match}, 3);
  for (const std::size_t origin : {0, 3}) {
    const LocalFrame local = LocalFrame::At(bundle_->panoramas()[origin]);
    const std::vector<PastFrame> frames = past.InLocal(*bundle_, local);
    ASSERT_EQ(frames.size(), 1U);
    const Rigid3 expected(map_from_cam.rotation, local.FromMap(map_from_cam.translation));
    EXPECT_THAT(frames[0].cam_from_local.Inverse(), Rigid3Near(expected, kExact_rad, kExact_m));
    ASSERT_EQ(frames[0].matches.size(), 1U);
    const Eigen::Vector3d point =
        local.LocalFromPano(bundle_->panoramas()[2]).translation + match.lever_in_map;
    EXPECT_LT((frames[0].matches[0].point_in_map - point).norm(), kExact_m);
    EXPECT_EQ(frames[0].matches[0].lever_in_map, match.lever_in_map);
  }
}

TEST_F(PastFramesTest, KeepTheNewestOlderFirst) {
  ASSERT_TRUE(bundle_);
  PastFrames past;
  for (int i = 0; i < 5; ++i) past.Add(i * kSecond_ns, At(i), {}, 2);
  const LocalFrame local;
  const std::vector<PastFrame> frames = past.InLocal(*bundle_, local);
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_NEAR(frames[0].cam_from_local.Inverse().translation.x(), 3, kExact_m);
  EXPECT_NEAR(frames[1].cam_from_local.Inverse().translation.x(), 4, kExact_m);
  PastFrames none;
  none.Add(0, At(0), {}, 0);
  EXPECT_EQ(NumFrames(none), 0U);
}

TEST_F(PastFramesTest, AgeAndTimesThatRunBackwardsForget) {
  ASSERT_TRUE(bundle_);
  PastFrames past;
  past.Add(0, At(0), {}, 3);
  past.Add(2 * kSecond_ns, At(1), {}, 3);
  past.Advance(3 * kSecond_ns, 3);
  EXPECT_EQ(NumFrames(past), 2U);
  past.Advance(4 * kSecond_ns, 3);
  EXPECT_EQ(NumFrames(past), 1U);
  past.Advance(2 * kSecond_ns, 3);  // stands still
  EXPECT_EQ(NumFrames(past), 0U);
  // No overflow at the ends of time.
  past.Add(std::numeric_limits<std::int64_t>::min(), At(0), {}, 3);
  past.Advance(std::numeric_limits<std::int64_t>::max(), 3);
  EXPECT_EQ(NumFrames(past), 0U);
}

}  // namespace
}  // namespace panofix
