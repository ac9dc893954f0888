// Bundles with right hashes and wrong content: no index may reach outside its array.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "common/map/map_bundle.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

using Change = std::function<void(CraftedBundle*)>;
using Changes = std::vector<std::pair<const char*, Change>>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kNanF = std::numeric_limits<float>::quiet_NaN();

void ExpectBadData(const Changes& changes) {
  for (const auto& [name, change] : changes) {
    const TempFolder folder;
    CraftedBundle crafted = SmallBundle();
    change(&crafted);
    crafted.Write(folder / "b");
    const Status status = MapBundle::Open(folder / "b").status();
    EXPECT_EQ(status.code(), ErrorCode::kBadData) << name << ": " << status.message();
    EXPECT_NE(status.message().find(folder.path().string()), std::string::npos) << status.message();
  }
}

TEST(BundleIndices, Panoramas) {
  ExpectBadData({
      {"link outside", [](CraftedBundle* b) { b->links[2] = 4; }},
      {"link far outside", [](CraftedBundle* b) { b->links[2] = ~0U; }},
      {"link offset outside", [](CraftedBundle* b) { b->link_offsets.back() = 7; }},
      {"link offsets descend",
       [](CraftedBundle* b) { std::swap(b->link_offsets[1], b->link_offsets[2]); }},
      {"link offsets start late", [](CraftedBundle* b) { b->link_offsets[0] = 1; }},
      {"link offsets cut", [](CraftedBundle* b) { b->link_offsets.pop_back(); }},
      {"link offsets gone", [](CraftedBundle* b) { b->link_offsets.clear(); }},
      {"id missing", [](CraftedBundle* b) { b->ids.pop_back(); }},
      {"id twice", [](CraftedBundle* b) { b->ids[1] = "a"; }},
      {"position missing", [](CraftedBundle* b) { b->positions.resize(9); }},
      {"geodetic missing", [](CraftedBundle* b) { b->geodetic.resize(9); }},
      {"depth flag missing", [](CraftedBundle* b) { b->has_depth.pop_back(); }},
      {"scale missing", [](CraftedBundle* b) { b->scales.pop_back(); }},
      {"rotation missing", [](CraftedBundle* b) { b->rotations.resize(12); }},
      {"position not finite", [](CraftedBundle* b) { b->positions[4] = kNan; }},
      {"geodetic not finite", [](CraftedBundle* b) { b->geodetic[4] = kNan; }},
      {"rotation not finite", [](CraftedBundle* b) { b->rotations[4] = kNan; }},
      {"rotation not unit", [](CraftedBundle* b) { b->rotations[3] = 1.01; }},
      {"rotation zero", [](CraftedBundle* b) { b->rotations[3] = 0; }},
      {"scale absurd", [](CraftedBundle* b) { b->scales[0] = 0; }},
      {"scale not finite", [](CraftedBundle* b) { b->scales[0] = kNan; }},
  });
}

TEST(BundleIndices, NoPanoramasOrViews) {
  ExpectBadData({
      {"no views", [](CraftedBundle* b) { b->directions.clear(); }},
      {"direction not finite", [](CraftedBundle* b) { b->directions[1] = kNan; }},
      {"no panoramas",
       [](CraftedBundle* b) {
         b->ids.clear(), b->geodetic.clear(), b->positions.clear(), b->rotations.clear();
         b->scales.clear(), b->has_depth.clear(), b->links.clear(), b->link_offsets = {0};
         b->similar.clear(), b->similar_offsets = {0}, b->tiles.clear();
       }},
  });
}

TEST(BundleIndices, Similarity) {
  ExpectBadData({
      {"view outside", [](CraftedBundle* b) { b->similar[5] = 8; }},
      {"view far outside", [](CraftedBundle* b) { b->similar[5] = ~0U; }},
      {"offset outside", [](CraftedBundle* b) { b->similar_offsets.back() = 17; }},
      {"offsets descend",
       [](CraftedBundle* b) { std::swap(b->similar_offsets[1], b->similar_offsets[2]); }},
      {"offsets cut", [](CraftedBundle* b) { b->similar_offsets.pop_back(); }},
      {"views cut", [](CraftedBundle* b) { b->similar.pop_back(); }},
  });
}

TEST(BundleIndices, VocabularyTrees) {
  ExpectBadData({
      {"child outside", [](CraftedBundle* b) { b->vocabulary.sift.first_child[0] = 6; }},
      {"loop", [](CraftedBundle* b) { b->vocabulary.sift.first_child[1] = 1; }},
      {"word outside", [](CraftedBundle* b) { b->vocabulary.mser.word[2] = 2; }},
      {"word twice",
       [](CraftedBundle* b) { b->vocabulary.sift.word[6] = b->vocabulary.sift.word[5]; }},
      {"counts cut", [](CraftedBundle* b) { b->vocabulary.sift.num_children.pop_back(); }},
      {"idf missing", [](CraftedBundle* b) { b->vocabulary.idf.pop_back(); }},
      {"idf not finite", [](CraftedBundle* b) { b->vocabulary.idf[0] = kNanF; }},
  });
}

TEST(BundleIndices, Tiles) {
  ExpectBadData({
      {"view offset outside", [](CraftedBundle* b) { b->tiles[0].view_offsets.back() += 1; }},
      {"view offsets descend",
       [](CraftedBundle* b) { b->tiles[0].view_offsets[1] = b->tiles[0].view_offsets[2] + 1; }},
      {"view offsets cut", [](CraftedBundle* b) { b->tiles[0].view_offsets.pop_back(); }},
      {"view too many", [](CraftedBundle* b) { b->tiles[0].EndView({}); }},
      {"points cut", [](CraftedBundle* b) { b->tiles[0].points.resize(4); }},
      {"descriptors cut", [](CraftedBundle* b) { b->tiles[0].descriptors.resize(128); }},
      {"surfaces cut", [](CraftedBundle* b) { b->tiles[0].surfaces.pop_back(); }},
      {"plane offset outside", [](CraftedBundle* b) { b->tiles[0].plane_offsets.back() += 1; }},
      {"plane offsets descend", [](CraftedBundle* b) { b->tiles[0].plane_offsets[1] = 7; }},
      {"plane offsets cut", [](CraftedBundle* b) { b->tiles[0].plane_offsets.pop_back(); }},
      {"point not finite", [](CraftedBundle* b) { b->tiles[0].points[1] = kNanF; }},
      {"keypoint not finite", [](CraftedBundle* b) { b->tiles[1].keypoints[0] = kNanF; }},
      {"unknown panorama", [](CraftedBundle* b) { b->tiles[0].panorama_ids[1] = "zz"; }},
      {"tile missing", [](CraftedBundle* b) { b->tiles.pop_back(); }},
      {"panorama in two tiles", [](CraftedBundle* b) { b->tiles[1].panorama_ids[0] = "a"; }},
      {"panorama twice in a tile", [](CraftedBundle* b) { b->tiles[0].panorama_ids[1] = "a"; }},
      {"tile twice",
       [](CraftedBundle* b) {
         b->tiles.push_back(b->tiles[0]);
         b->tiles.back().path = "tiles/2.h5";
       }},
  });
}

TEST(BundleIndices, Bags) {
  ExpectBadData({
      {"word outside", [](CraftedBundle* b) { b->tiles[0].words[1] = 6; }},
      {"word far outside", [](CraftedBundle* b) { b->tiles[0].words[1] = ~0U; }},
      {"offset outside", [](CraftedBundle* b) { b->tiles[0].bag_offsets.back() += 1; }},
      {"offsets cut", [](CraftedBundle* b) { b->tiles[0].bag_offsets.pop_back(); }},
      {"weights cut", [](CraftedBundle* b) { b->tiles[0].weights.pop_back(); }},
      {"weight not finite", [](CraftedBundle* b) { b->tiles[0].weights[0] = kNanF; }},
  });
}

TEST(BundleIndices, PartsThatAreNoHdf5) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  crafted.extra_parts = {{"tiles/9.h5", "this is not HDF5"}};
  crafted.Write(folder / "b");
  EXPECT_EQ(MapBundle::Open(folder / "b").status().code(), ErrorCode::kBadData);
}

}  // namespace
}  // namespace panofix
