#include <gtest/gtest.h>

#include "builder/extract/panorama_features.h"
#include "common/io/hdf5_file.h"
#include "tests/common/features/random_descriptors.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

FeatureSet RandomSet(std::size_t count, Rng* rng) {
  FeatureSet set;
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = [&] { return static_cast<float>(rng->Uniform(0, 500)); };
    set.keypoints.push_back({value(), value(), value(), value(), value()});
  }
  set.descriptors = RandomDescriptors(count, rng);
  return set;
}

PanoramaFeatures Sample() {
  Rng rng(1, "tests/features_file");
  PanoramaFeatures features;
  features.has_depth = true;
  features.depth_fault = "x.gsv: half of it is missing";
  features.planes = {{{0, 0, 0}, 0}, {{0, 0, -1}, 2.5F}};
  features.sources = {"itself", "neighbour é"};
  for (const std::size_t count : {5, 0, 3}) {
    ViewFeatureSet view;
    view.sift = RandomSet(count, &rng);
    view.mser = RandomSet(count / 2, &rng);
    for (std::size_t i = 0; i < count; ++i) {
      view.points.push_back({Eigen::Vector3f::Constant(static_cast<float>(i)), 0.5F, 1,
                             static_cast<std::uint8_t>(i % 2)});
    }
    features.views.push_back(view);
  }
  return features;
}

void ExpectSame(const FeatureSet& a, const FeatureSet& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.descriptors, b.descriptors);
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Keypoint &x = a.keypoints[i], &y = b.keypoints[i];
    EXPECT_TRUE(x.x_px == y.x_px && x.y_px == y.y_px && x.size_px == y.size_px &&
                x.angle_deg == y.angle_deg && x.response == y.response);
  }
}

TEST(FeaturesFile, RoundTrip) {
  const TempFolder folder;
  const PanoramaFeatures features = Sample();
  WritePanoramaFeatures(folder / "p.h5", features);
  const auto back = ReadPanoramaFeatures(folder / "p.h5");
  ASSERT_TRUE(back.ok()) << back.status().message();
  EXPECT_TRUE(back->has_depth);
  EXPECT_EQ(back->depth_fault, features.depth_fault);
  EXPECT_EQ(back->sources, features.sources);
  ASSERT_EQ(back->planes.size(), 2U);
  EXPECT_EQ(back->planes[1].normal_in_pano, Eigen::Vector3f(0, 0, -1));
  EXPECT_EQ(back->planes[1].d_m, 2.5F);
  ASSERT_EQ(back->views.size(), 3U);
  for (std::size_t v = 0; v < 3; ++v) {
    ExpectSame(back->views[v].sift, features.views[v].sift);
    ExpectSame(back->views[v].mser, features.views[v].mser);
    ASSERT_EQ(back->views[v].points.size(), features.views[v].points.size());
    for (std::size_t i = 0; i < back->views[v].points.size(); ++i) {
      const SurfacePoint &p = back->views[v].points[i], &q = features.views[v].points[i];
      EXPECT_EQ(p.point_in_pano, q.point_in_pano);
      EXPECT_EQ(p.range_sigma_m, q.range_sigma_m);
      EXPECT_EQ(p.surface_idx, q.surface_idx);
      EXPECT_EQ(p.source_idx, q.source_idx);
    }
  }
}

TEST(FeaturesFile, EqualFeaturesGiveEqualBytesAndNothingElse) {
  const TempFolder folder;
  WritePanoramaFeatures(folder / "a.h5", Sample());
  WritePanoramaFeatures(folder / "b.h5", Sample());
  EXPECT_EQ(ReadText(folder / "a.h5"), ReadText(folder / "b.h5"));
  const std::filesystem::directory_iterator files(folder.path());
  EXPECT_EQ(std::distance(begin(files), end(files)), 2);
}

TEST(FeaturesFile, WritesOverAnOldFile) {
  const TempFolder folder;
  WriteText(folder / "p.h5", "an old file");
  WritePanoramaFeatures(folder / "p.h5", Sample());
  EXPECT_TRUE(ReadPanoramaFeatures(folder / "p.h5").ok());
}

TEST(FeaturesFile, WhatCannotBeReadIsSaidNotThrown) {
  const TempFolder folder;
  EXPECT_FALSE(ReadPanoramaFeatures(folder / "none.h5").ok());
  WriteText(folder / "text.h5", "no HDF5");
  EXPECT_FALSE(ReadPanoramaFeatures(folder / "text.h5").ok());
  WritePanoramaFeatures(folder / "cut.h5", Sample());
  std::filesystem::resize_file(folder / "cut.h5",
                               std::filesystem::file_size(folder / "cut.h5") / 2);
  EXPECT_FALSE(ReadPanoramaFeatures(folder / "cut.h5").ok());
}

// Arrays of a view with two keypoints, which may be of other lengths.
struct Uneven {
  std::size_t descriptors = 2, points = 2, surfaces = 2, sources = 2;
  std::int64_t views = 1;
  std::uint8_t source_idx = 0;  // of every point
};

ErrorCode CodeOf(const std::filesystem::path& path, const Uneven& u) {
  {
    Hdf5Writer file(path);
    file.WriteAttribute("has_depth", 1);
    file.WriteAttribute("depth_fault", std::string());
    file.WriteAttribute("num_views", u.views);
    file.WriteStrings("sources", {"itself"});
    file.Write<float>("planes", std::vector<float>(4), 4);
    file.Write<float>("view000/sift/keypoints", std::vector<float>(10), 5);
    file.Write<std::uint8_t>("view000/sift/descriptors",
                             std::vector<std::uint8_t>(128 * u.descriptors), 128);
    file.Write<float>("view000/mser/keypoints", std::vector<float>(), 5);
    file.Write<std::uint8_t>("view000/mser/descriptors", std::vector<std::uint8_t>(), 128);
    file.Write<float>("view000/points", std::vector<float>(4 * u.points), 4);
    file.Write<std::uint8_t>("view000/surfaces", std::vector<std::uint8_t>(u.surfaces));
    file.Write<std::uint8_t>("view000/sources", std::vector<std::uint8_t>(u.sources, u.source_idx));
    file.Close();
  }
  return ReadPanoramaFeatures(path).status().code();
}

TEST(FeaturesFile, ArraysOfUnequalLengthAreRefused) {
  const TempFolder folder;
  EXPECT_EQ(CodeOf(folder / "p.h5", {}), ErrorCode::kOk);
  EXPECT_EQ(CodeOf(folder / "p.h5", {1, 2, 2, 2}), ErrorCode::kBadData);
  EXPECT_EQ(CodeOf(folder / "p.h5", {2, 3, 3, 3}), ErrorCode::kBadData);
  EXPECT_EQ(CodeOf(folder / "p.h5", {2, 2, 1, 2}), ErrorCode::kBadData);
  EXPECT_EQ(CodeOf(folder / "p.h5", {2, 2, 2, 1}), ErrorCode::kBadData);
  EXPECT_NE(CodeOf(folder / "p.h5", {2, 2, 2, 2, 2}), ErrorCode::kOk);
}

// Whoever reads it looks the source up.
TEST(FeaturesFile, ASourceOutsideTheSourcesIsRefused) {
  const TempFolder folder;
  EXPECT_EQ(CodeOf(folder / "p.h5", {2, 2, 2, 2, 1, 1}), ErrorCode::kBadData);
  EXPECT_EQ(CodeOf(folder / "p.h5", {2, 2, 2, 2, 1, 255}), ErrorCode::kBadData);
}

TEST(FeaturesFile, AFolderThatIsNotThereThrows) {
  const TempFolder folder;
  EXPECT_THROW(WritePanoramaFeatures(folder / "none" / "p.h5", Sample()), Error);
}

}  // namespace
}  // namespace panofix
