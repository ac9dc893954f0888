#include "builder/pipeline/key_parts.h"

#include <gtest/gtest.h>

#include <set>
#include <stdexcept>

namespace panofix {
namespace {

KeyParts Key(const std::vector<std::pair<std::string, std::string>>& parts) {
  KeyParts key;
  for (const auto& [name, value] : parts) key.Add(name, value);
  return key;
}

TEST(KeyParts, EveryNameAndValueCounts) {
  const std::set<std::string> keys = {
      Key({}).Hex(),
      Key({{"a", ""}}).Hex(),
      Key({{"a", "1"}}).Hex(),
      Key({{"b", "1"}}).Hex(),
      Key({{"a", "1"}, {"b", "1"}}).Hex(),
      Key({{"a", "1"}, {"b", "2"}}).Hex(),
      Key({{"a b", "1"}}).Hex(),
      Key({{"a\nb", "1"}}).Hex(),
  };
  EXPECT_EQ(keys.size(), 8U);
}

TEST(KeyParts, TheOrderDoesNotCount) {
  EXPECT_EQ(Key({{"a", "1"}, {"b", "2"}}).Hex(), Key({{"b", "2"}, {"a", "1"}}).Hex());
}

TEST(KeyParts, ANameTwiceIsACallersFault) {
  KeyParts key;
  key.Add("a", "1");
  EXPECT_THROW(key.Add("a", "1"), std::logic_error);
}

TEST(WhyDifferent, NamesWhatChangedCameAndWent) {
  const PartDigests before = Key({{"image", "1"}, {"mask", "-"}, {"pano-2", "x"}}).digests();
  EXPECT_EQ(WhyDifferent(before, before), "");
  EXPECT_EQ(WhyDifferent(before, Key({{"image", "2"}, {"mask", "-"}, {"pano-2", "x"}}).digests()),
            "image");
  EXPECT_EQ(WhyDifferent(before, Key({{"image", "2"}, {"mask", "-"}, {"pano-3", "x"}}).digests()),
            "pano-2 is gone, pano-3 is new, image");
  EXPECT_EQ(
      WhyDifferent({}, Key({{"a", ""}, {"b", ""}, {"c", ""}, {"d", ""}, {"e", ""}}).digests()),
      "a is new, b is new, c is new and 2 more");
  // A place comes and goes with its panorama; that it moved is news.
  const auto placed = [](const char* place) {
    KeyParts key;
    key.AddPanorama("p", "1");
    key.AddPlace("p", place);
    return key.digests();
  };
  EXPECT_EQ(WhyDifferent({}, placed("1")), "panorama p is new");
  EXPECT_EQ(WhyDifferent(placed("1"), {}), "panorama p is gone");
  EXPECT_EQ(WhyDifferent(placed("1"), placed("2")), "place of panorama p");
}

// Ids are free: none may pass for a part of another kind.
TEST(KeyParts, IdsMeetNoOtherNames) {
  KeyParts key;
  for (const char* name : {"options", "program"}) key.Add(name, "");
  for (const char* id : {"options", "program", "p", "panorama p", "place of panorama p", ""}) {
    EXPECT_NO_THROW(key.AddPanorama(id, ""));
    EXPECT_NO_THROW(key.AddPlace(id, ""));
  }
}

}  // namespace
}  // namespace panofix
