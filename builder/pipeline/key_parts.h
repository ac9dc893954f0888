#pragma once
// What decides the content of a work file, part by part: its name, and why it was made again.

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace panofix {

// Name of a part -> short digest of its value.
using PartDigests = std::map<std::string, std::string>;

// Collects named values. Equal keys mean equal names and values.
class KeyParts {
 public:
  // `name` is for people: "image", "options". A name given twice is a caller's fault
  // (std::logic_error).
  void Add(const std::string& name, std::string_view value);
  // What was made of a panorama, and where it stands. Ids are the user's: they never meet the names
  // above.
  void AddPanorama(const std::string& id, std::string_view value);
  void AddPlace(const std::string& id, std::string_view value);
  [[nodiscard]] std::string Hex() const;  // SHA-256 over all parts
  [[nodiscard]] const PartDigests& digests() const { return digests_; }

 private:
  PartDigests digests_;
  std::map<std::string, std::string> values_;
};

// Why what `before` decided is not what `now` decides, in a few words: "image", "panorama p3
// is new", "panorama p7 is gone, options". Empty where all parts are equal.
[[nodiscard]] std::string WhyDifferent(const PartDigests& before, const PartDigests& now);

}  // namespace panofix
