// Bundles with right hashes and wrong content: no index may reach outside its array.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <span>

#include "common/map/landmark_codes.h"
#include "common/map/map_bundle.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

using Change = std::function<void(CraftedBundle*)>;
using Changes = std::vector<std::pair<const char*, Change>>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kNanF = std::numeric_limits<float>::quiet_NaN(),
                kInfF = std::numeric_limits<float>::infinity();

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
      {"geotag flag missing", [](CraftedBundle* b) { b->is_flagged.pop_back(); }},
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

TEST(BundleIndices, Stations) {
  ExpectBadData({
      {"panorama outside", [](CraftedBundle* b) { b->station_panoramas[4] = 4; }},
      {"panorama far outside", [](CraftedBundle* b) { b->station_panoramas[4] = ~0U; }},
      {"first panorama without one", [](CraftedBundle* b) { b->station_panoramas[0] = 1; }},
      {"panorama between without one", [](CraftedBundle* b) { b->station_panoramas[3] = 1; }},
      {"last panorama without one", [](CraftedBundle* b) { b->station_panoramas[4] = 2; }},
      {"not in order",
       [](CraftedBundle* b) { std::swap(b->station_panoramas[0], b->station_panoramas[1]); }},
      {"panorama is not its first station",
       [](CraftedBundle* b) {
         for (int i = 0; i < 3; ++i)
           std::swap(b->station_positions[3 + i], b->station_positions[6 + i]);
       }},
      {"position missing", [](CraftedBundle* b) { b->station_positions.resize(12); }},
      {"position too many", [](CraftedBundle* b) { b->station_positions.resize(18); }},
      {"position not finite", [](CraftedBundle* b) { b->station_positions[7] = kNanF; }},
      {"position infinite", [](CraftedBundle* b) { b->station_positions[7] = kInfF; }},
      {"station of no tile's view",
       [](CraftedBundle* b) {
         b->AddStation({0, 1, 0});
       }},
      {"stations gone",
       [](CraftedBundle* b) { b->station_panoramas.clear(), b->station_positions.clear(); }},
  });
}

TEST(BundleIndices, NoPanoramasOrViews) {
  ExpectBadData({
      {"no views", [](CraftedBundle* b) { b->directions.clear(); }},
      {"direction not finite", [](CraftedBundle* b) { b->directions[1] = kNan; }},
      {"no panoramas",
       [](CraftedBundle* b) {
         b->ids.clear(), b->geodetic.clear(), b->positions.clear(), b->rotations.clear();
         b->scales.clear(), b->has_depth.clear(), b->is_flagged.clear();
         b->links.clear(), b->link_offsets = {0};
         b->station_panoramas.clear(), b->station_positions.clear();
         b->similar.clear(), b->similar_offsets = {0}, b->tiles.clear();
       }},
  });
}

TEST(BundleIndices, Similarity) {
  ExpectBadData({
      {"view outside", [](CraftedBundle* b) { b->similar[5] = 10; }},
      {"view far outside", [](CraftedBundle* b) { b->similar[5] = ~0U; }},
      {"offset outside", [](CraftedBundle* b) { b->similar_offsets.back() = 17; }},
      {"offsets descend",
       [](CraftedBundle* b) { std::swap(b->similar_offsets[1], b->similar_offsets[2]); }},
      {"offsets start late", [](CraftedBundle* b) { b->similar_offsets[0] = 1; }},
      {"offsets cut", [](CraftedBundle* b) { b->similar_offsets.pop_back(); }},
      {"a row a view of every station",
       [](CraftedBundle* b) { b->similar_offsets.insert(b->similar_offsets.end(), 2, 16); }},
      {"views cut", [](CraftedBundle* b) { b->similar.pop_back(); }},
  });
}

TEST(BundleIndices, VocabularyTrees) {
  ExpectBadData({
      {"no SIFT words",
       [](CraftedBundle* b) {
         b->vocabulary.sift = {};
         b->vocabulary.idf.resize(2);
         for (CraftedTile& tile : b->tiles) {
           for (std::uint32_t& word : tile.words) word = 0;
         }
       }},
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

TEST(BundleIndices, TilesPanoramas) {
  ExpectBadData({
      {"unknown panorama", [](CraftedBundle* b) { b->tiles[0].panorama_ids[1] = "zz"; }},
      {"panorama missing", [](CraftedBundle* b) { b->tiles[0].panorama_ids.pop_back(); }},
      {"panorama too many", [](CraftedBundle* b) { b->tiles[1].panorama_ids.push_back("a"); }},
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

TEST(BundleIndices, Anchors) {
  ExpectBadData({
      {"unknown panorama", [](CraftedBundle* b) { b->tiles[0].anchor_ids[1] = "zz"; }},
      {"id missing", [](CraftedBundle* b) { b->tiles[0].anchor_ids.pop_back(); }},
      {"id too many", [](CraftedBundle* b) { b->tiles[0].anchor_ids.push_back("c"); }},
      {"landmark offset outside", [](CraftedBundle* b) { b->tiles[0].anchor_offsets.back() += 1; }},
      {"landmark offset far outside",
       [](CraftedBundle* b) { b->tiles[0].anchor_offsets[1] = ~0U; }},
      {"landmark of no anchor", [](CraftedBundle* b) { b->tiles[0].anchor_offsets.back() -= 1; }},
      {"landmark offsets descend",
       [](CraftedBundle* b) { b->tiles[1].anchor_offsets[1] = b->tiles[1].anchor_offsets[2] + 1; }},
      {"landmark offsets start late", [](CraftedBundle* b) { b->tiles[0].anchor_offsets[0] = 1; }},
      {"landmark offsets cut", [](CraftedBundle* b) { b->tiles[0].anchor_offsets.pop_back(); }},
      {"landmark offsets gone", [](CraftedBundle* b) { b->tiles[0].anchor_offsets.clear(); }},
      {"plane offset outside", [](CraftedBundle* b) { b->tiles[0].plane_offsets.back() += 1; }},
      {"plane offsets descend", [](CraftedBundle* b) { b->tiles[0].plane_offsets[1] = 7; }},
      {"plane offsets start late", [](CraftedBundle* b) { b->tiles[0].plane_offsets[0] = 1; }},
      {"plane offsets cut", [](CraftedBundle* b) { b->tiles[0].plane_offsets.pop_back(); }},
      {"plane offsets gone", [](CraftedBundle* b) { b->tiles[0].plane_offsets.clear(); }},
      {"planes cut", [](CraftedBundle* b) { b->tiles[0].planes.resize(30); }},
  });
}

TEST(BundleIndices, Landmarks) {
  ExpectBadData({
      {"points cut", [](CraftedBundle* b) { b->tiles[0].points.resize(12); }},
      {"codes cut", [](CraftedBundle* b) { b->tiles[0].codes.resize(24); }},
      {"codes too many", [](CraftedBundle* b) { b->tiles[0].codes.resize(36); }},
      {"codes of another width",
       [](CraftedBundle* b) { b->tiles[0].code_cols = 5, b->tiles[0].codes.resize(25); }},
      {"descriptors cut", [](CraftedBundle* b) { b->tiles[0].descriptors.resize(4 * 128); }},
      {"descriptors too many", [](CraftedBundle* b) { b->tiles[0].descriptors.resize(6 * 128); }},
      {"descriptors of half the bytes",
       [](CraftedBundle* b) { b->tiles[0].descriptor_cols = kPackedDescriptorSize; }},
      {"descriptors of 32",
       [](CraftedBundle* b) {
         b->tiles[0].descriptor_cols = 32, b->tiles[0].descriptors.resize(5 * 32);
       }},
      {"descriptors of 256",
       [](CraftedBundle* b) {
         b->tiles[0].descriptor_cols = 256, b->tiles[0].descriptors.resize(5 * 256);
       }},
      {"point not finite", [](CraftedBundle* b) { b->tiles[0].points[1] = kNanF; }},
      {"point infinite", [](CraftedBundle* b) { b->tiles[1].points[14] = kInfF; }},
  });
}

TEST(BundleIndices, WordsOfLandmarks) {
  const auto with = [](const std::function<void(std::vector<std::uint32_t>*)>& change) {
    return [change](CraftedBundle* b) {
      b->AddWords();
      change(&*b->tiles[0].landmark_words);
    };
  };
  const TempFolder folder;
  CraftedBundle good = SmallBundle();
  with([](auto*) {})(&good);
  good.Write(folder / "b");
  const auto opened = MapBundle::Open(folder / "b");
  ASSERT_TRUE(opened.ok()) << opened.status().message();
  const std::span<const std::uint32_t> words = (*opened)->tiles().Get(0).words();
  EXPECT_TRUE(std::equal(words.begin(), words.end(), good.tiles[0].landmark_words->begin(),
                         good.tiles[0].landmark_words->end()));
  ExpectBadData({
      {"word of MSER", with([](auto* w) { (*w)[1] = 4; })},
      {"word outside", with([](auto* w) { w->back() = 6; })},
      {"word far outside", with([](auto* w) { (*w)[0] = ~0U; })},
      {"words cut", with([](auto* w) { w->pop_back(); })},
      {"words too many", with([](auto* w) { w->push_back(0); })},
      {"words gone", with([](auto* w) { w->clear(); })},
  });
}

TEST(BundleIndices, Views) {
  ExpectBadData({
      {"landmark outside", [](CraftedBundle* b) { b->tiles[0].view_landmarks[3] = 5; }},
      {"landmark far outside", [](CraftedBundle* b) { b->tiles[0].view_landmarks[3] = ~0U; }},
      {"landmarks cut", [](CraftedBundle* b) { b->tiles[0].view_landmarks.pop_back(); }},
      {"offset outside", [](CraftedBundle* b) { b->tiles[0].view_offsets.back() += 1; }},
      {"offset far outside", [](CraftedBundle* b) { b->tiles[0].view_offsets[2] = ~0U; }},
      {"offsets descend",
       [](CraftedBundle* b) { b->tiles[0].view_offsets[1] = b->tiles[0].view_offsets[2] + 1; }},
      {"offsets start late", [](CraftedBundle* b) { b->tiles[0].view_offsets[0] = 1; }},
      {"offsets cut", [](CraftedBundle* b) { b->tiles[0].view_offsets.pop_back(); }},
      {"offsets gone", [](CraftedBundle* b) { b->tiles[0].view_offsets.clear(); }},
      {"view too many", [](CraftedBundle* b) { b->tiles[0].EndView({}, {}); }},
      {"view missing",
       [](CraftedBundle* b) {
         CraftedTile& tile = b->tiles[0];
         tile.view_offsets.pop_back(), tile.view_landmarks.resize(tile.view_offsets.back());
         tile.bag_offsets.pop_back(), tile.words.resize(tile.bag_offsets.back());
         tile.weights.resize(tile.bag_offsets.back());
       }},
  });
}

TEST(BundleIndices, Bags) {
  ExpectBadData({
      {"word outside", [](CraftedBundle* b) { b->tiles[0].words[1] = 6; }},
      {"word far outside", [](CraftedBundle* b) { b->tiles[0].words[1] = ~0U; }},
      {"offset outside", [](CraftedBundle* b) { b->tiles[0].bag_offsets.back() += 1; }},
      {"offset far outside", [](CraftedBundle* b) { b->tiles[0].bag_offsets[3] = ~0U; }},
      {"offsets start late", [](CraftedBundle* b) { b->tiles[0].bag_offsets[0] = 1; }},
      {"offsets cut", [](CraftedBundle* b) { b->tiles[0].bag_offsets.pop_back(); }},
      {"offsets gone", [](CraftedBundle* b) { b->tiles[0].bag_offsets.clear(); }},
      {"words cut", [](CraftedBundle* b) { b->tiles[0].words.pop_back(); }},
      {"weights cut", [](CraftedBundle* b) { b->tiles[0].weights.pop_back(); }},
  });
}

// Eight pictures of three bytes, which is no picture: decoding is another test's.
CraftedImages SomeImages() {
  CraftedImages images;
  images.path = "images/0.h5", images.panorama_ids = {"a", "b", "c", "d"};
  for (std::uint32_t i = 1; i <= 8; ++i) images.offsets.push_back(3 * i);
  images.jpeg.assign(24, 0xFF);
  return images;
}

TEST(BundleIndices, ViewImages) {
  const auto with = [](const std::function<void(CraftedImages*)>& change) {
    return [change](CraftedBundle* b) {
      b->images = {SomeImages()};
      change(&b->images[0]);
    };
  };
  const TempFolder folder;
  CraftedBundle good = SmallBundle();
  good.images = {SomeImages()};
  good.Write(folder / "b");
  const auto opened = MapBundle::Open(folder / "b");
  ASSERT_TRUE(opened.ok()) << opened.status().message();
  EXPECT_TRUE((*opened)->has_view_images());
  ExpectBadData({
      {"of some panoramas alone", with([](CraftedImages* i) {
         i->panorama_ids.pop_back(), i->offsets.resize(7), i->jpeg.resize(18);
       })},
      {"unknown panorama", with([](CraftedImages* i) { i->panorama_ids[1] = "zz"; })},
      {"panorama twice", with([](CraftedImages* i) { i->panorama_ids[1] = "a"; })},
      {"panorama missing", with([](CraftedImages* i) { i->panorama_ids.pop_back(); })},
      {"offset outside", with([](CraftedImages* i) { i->offsets.back() = 25; })},
      {"offset far outside", with([](CraftedImages* i) { i->offsets[2] = ~0U; })},
      {"offsets descend", with([](CraftedImages* i) { std::swap(i->offsets[1], i->offsets[2]); })},
      {"offsets start late", with([](CraftedImages* i) { i->offsets[0] = 1; })},
      {"offsets cut", with([](CraftedImages* i) { i->offsets.pop_back(); })},
      {"offsets gone", with([](CraftedImages* i) { i->offsets.clear(); })},
      {"bytes cut", with([](CraftedImages* i) { i->jpeg.pop_back(); })},
      {"panorama in two parts",
       [](CraftedBundle* b) {
         b->images = {SomeImages(), SomeImages()};
         b->images[1].path = "images/1.h5";
       }},
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
