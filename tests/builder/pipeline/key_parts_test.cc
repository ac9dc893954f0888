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
  const PartDigests placed = Key({{"p", "1"}, {"p's place", "1"}}).digests();
  EXPECT_EQ(WhyDifferent({}, placed), "p is new");
  EXPECT_EQ(WhyDifferent(placed, {}), "p is gone");
  EXPECT_EQ(WhyDifferent(placed, Key({{"p", "1"}, {"p's place", "2"}}).digests()), "p's place");
}

}  // namespace
}  // namespace panofix
