#include "common/package/delta_index.h"

#include <nlohmann/json.hpp>
#include <stdexcept>

#include "common/base/log.h"

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMajor = 1, kMinor = 0;

std::string HashFrom(const Json& j) {
  auto text = j.get<std::string>();
  if (text.size() != 64 || text.find_first_not_of("0123456789abcdef") != std::string::npos)
    throw std::invalid_argument("'" + text.substr(0, 80) + "' is no SHA-256");
  return text;
}

DeltaIndex IndexFrom(const Json& j) {
  DeltaIndex index;
  if (!j.at("base").is_null()) index.base = HashFrom(j.at("base"));
  index.target = HashFrom(j.at("target"));
  for (const Json& patch : j.at("patches")) {
    if (!index.patches.emplace(HashFrom(patch.at("object")), HashFrom(patch.at("from"))).second)
      throw std::invalid_argument("an object has two patches");
  }
  return index;
}

}  // namespace

std::string ToJson(const DeltaIndex& index) {
  Json patches = Json::array();
  for (const auto& [object, from] : index.patches)
    patches.push_back({{"object", object}, {"from", from}});
  const Json j = {{"format", {{"name", "panofix-delta"}, {"major", kMajor}, {"minor", kMinor}}},
                  {"base", index.base.empty() ? Json() : Json(index.base)},
                  {"target", index.target},
                  {"patches", patches}};
  return j.dump(1) + "\n";
}

Result<DeltaIndex> ParseDeltaIndex(const std::string& text, const std::string& name) {
  try {
    const Json j = Json::parse(text);
    if (j.at("format").at("name") != "panofix-delta")
      throw std::invalid_argument("not a panofix package");
    const int major = j.at("format").at("major").get<int>();
    if (major != kMajor) {
      return Status(ErrorCode::kUnsupportedVersion,
                    Format("%s: package format %d, this program reads format %d; %s", name.c_str(),
                           major, kMajor, major > kMajor ? "update panofix" : "pack it again"));
    }
    return IndexFrom(j);
  } catch (const std::exception& error) {
    return Status(ErrorCode::kBadData, name + ": " + error.what() +
                                           "; get the package again, as panofix-builder wrote it");
  }
}

int PatchWindowLog(std::uint64_t base_bytes, std::uint64_t target_bytes) {
  int log = 10;  // zstd's least
  while (log < 30 && (std::uint64_t{1} << log) < base_bytes + target_bytes) ++log;
  return log;
}

}  // namespace panofix
