#include "builder/pipeline/key_parts.h"

#include <stdexcept>

#include "common/base/log.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

const std::string kPlaceOf = "place of panorama ";

}  // namespace

void KeyParts::Add(const std::string& name, std::string_view value) {
  const std::string digest = Sha256Hex(value);
  if (!values_.emplace(name, digest).second)
    throw std::logic_error("KeyParts: '" + name + "' is given twice");
  constexpr std::size_t kShort = 12;  // for reasons, not for identity
  digests_[name] = digest.substr(0, kShort);
}

void KeyParts::AddPanorama(const std::string& id, std::string_view value) {
  Add("panorama " + id, value);
}

void KeyParts::AddPlace(const std::string& id, std::string_view value) {
  Add(kPlaceOf + id, value);
}

std::string KeyParts::Hex() const {
  Sha256 hash;
  for (const auto& [name, digest] : values_) {
    hash.Update(Format("%zu ", name.size()) + name + " " + digest + "\n");
  }
  return hash.FinishHex();
}

std::string WhyDifferent(const PartDigests& before, const PartDigests& now) {
  constexpr std::size_t kMostNamed = 3;
  // What came or went is the cause; what changed beside it is often its consequence.
  std::vector<std::string> reasons, changed;
  const auto says_more = [](const std::string& name) { return !name.starts_with(kPlaceOf); };
  for (const auto& [name, digest] : before) {
    if (!now.contains(name) && says_more(name)) reasons.push_back(name + " is gone");
  }
  for (const auto& [name, digest] : now) {
    const auto found = before.find(name);
    if (found == before.end()) {
      if (says_more(name)) reasons.push_back(name + " is new");
    } else if (found->second != digest) {
      changed.push_back(name);
    }
  }
  reasons.insert(reasons.end(), changed.begin(), changed.end());
  std::string text;
  for (std::size_t i = 0; i < reasons.size() && i < kMostNamed; ++i)
    text += (i == 0 ? "" : ", ") + reasons[i];
  if (reasons.size() > kMostNamed) text += Format(" and %zu more", reasons.size() - kMostNamed);
  return text;
}

}  // namespace panofix
