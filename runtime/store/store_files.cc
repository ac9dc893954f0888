#include "runtime/store/store_files.h"

#include <nlohmann/json.hpp>
#include <stdexcept>

#include "common/io/atomic_file.h"
#include "common/io/read_file.h"
#include "common/sign/utc_time.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kStoreFormat = 1;
constexpr std::size_t kMaxBytes = std::size_t{1} << 20;

void RequireFormat(const Json& j) {
  if (j.at("format") != kStoreFormat)
    throw std::invalid_argument("not of format 1; use the panofix that wrote it");
}

std::string IdFrom(const Json& j, const char* key) {
  const auto id = j.at(key).get<std::string>();
  if (!id.empty() && !IsSha256(id))
    throw std::invalid_argument(std::string(key) + " is no bundle id");
  return id;
}

template <typename Parse>
auto ReadJson(const fs::path& path, const std::string& mend, const Parse& parse)
    -> Result<decltype(parse(Json()))> {
  const auto text = ReadFileText(path, kMaxBytes);
  if (!text.ok()) return Status(text.status().code(), text.status().message() + mend);
  try {
    const Json j = Json::parse(*text);
    RequireFormat(j);
    return parse(j);
  } catch (const std::exception& error) {
    return Status(ErrorCode::kBadData, path.string() + ": " + error.what() + mend);
  }
}

constexpr char kFsckMend[] = "; mend it with panofix-runtime fsck --repair";
constexpr char kInitMend[] = "; make a store with panofix-runtime init --store";

StoreConfig ConfigFrom(const Json& j) {
  StoreConfig config;
  j.at("map").get_to(config.map_name);
  const Json& camera = j.at("camera");
  camera.at("width_px").get_to(config.camera.width_px);
  camera.at("height_px").get_to(config.camera.height_px);
  camera.at("fx_px").get_to(config.camera.fx_px);
  camera.at("fy_px").get_to(config.camera.fy_px);
  camera.at("cx_px").get_to(config.camera.cx_px);
  camera.at("cy_px").get_to(config.camera.cy_px);
  return config;
}

StoreState StateFrom(const Json& j) {
  StoreState state;
  state.active = IdFrom(j, "active"), state.previous = IdFrom(j, "previous");
  j.at("is_proven").get_to(state.is_proven);
  if (j.contains("before_previous")) state.before_previous = IdFrom(j, "before_previous");
  j.at("highest_build").get_to(state.highest_build);
  state.highest_id = IdFrom(j, "highest_id");
  const auto floor_s = ParseUtc(j.at("time_floor").get<std::string>());
  if (!floor_s) throw std::invalid_argument("time_floor is no time");
  state.time_floor_s = *floor_s;
  return state;
}

StoreKeys KeysFrom(const Json& j) {
  StoreKeys keys;
  for (const Json& entry : j.at("trusted")) {
    auto key = ParsePublicKey(entry.at("public_key").get<std::string>(), "public_key");
    if (!key.ok()) throw std::invalid_argument(key.status().message());
    keys.ring.trusted.push_back(*key);
    keys.endorsed_by.push_back(entry.at("endorsed_by").get<std::string>());
  }
  j.at("revoked").get_to(keys.ring.revoked);
  // An empty ring means "development" elsewhere; a store always has a key.
  if (keys.ring.empty()) throw std::invalid_argument("no trusted key");
  return keys;
}

}  // namespace

bool IsSha256(const std::string& text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

Result<StoreConfig> ReadStoreConfig(const StoreLayout& layout) {
  return ReadJson(layout.config(), kInitMend, ConfigFrom);
}

Result<StoreState> ReadStoreState(const StoreLayout& layout) {
  std::error_code error;
  if (!fs::exists(layout.state(), error)) {
    // What was seen here is forgotten: an older map would get in.
    if (fs::directory_iterator(layout.versions(), error) != fs::directory_iterator() && !error)
      return Status(ErrorCode::kBadData,
                    layout.state().string() + ": is missing, though versions are here" + kFsckMend);
    return StoreState{};
  }
  return ReadJson(layout.state(), kFsckMend, StateFrom);
}

Result<StoreKeys> ReadStoreKeys(const StoreLayout& layout) {
  return ReadJson(layout.keys(), kInitMend, KeysFrom);
}

Status WriteStoreConfig(const StoreLayout& layout, const StoreConfig& config) {
  const Camera& c = config.camera;
  const Json j = {{"format", kStoreFormat},
                  {"map", config.map_name},
                  {"camera",
                   {{"width_px", c.width_px},
                    {"height_px", c.height_px},
                    {"fx_px", c.fx_px},
                    {"fy_px", c.fy_px},
                    {"cx_px", c.cx_px},
                    {"cy_px", c.cy_px}}}};
  return WriteFileAtomically(layout.config(), j.dump(1) + "\n");
}

Status WriteStoreState(const StoreLayout& layout, const StoreState& state) {
  Json j = {{"format", kStoreFormat},
            {"active", state.active},
            {"previous", state.previous},
            {"is_proven", state.is_proven},
            {"highest_build", state.highest_build},
            {"highest_id", state.highest_id},
            {"time_floor", FormatUtc(state.time_floor_s)}};
  if (!state.before_previous.empty()) j["before_previous"] = state.before_previous;
  return WriteFileAtomically(layout.state(), j.dump(1) + "\n");
}

Status WriteStoreKeys(const StoreLayout& layout, const StoreKeys& keys) {
  Json trusted = Json::array();
  for (std::size_t i = 0; i < keys.ring.trusted.size(); ++i) {
    const std::string text = FormatPublicKey(keys.ring.trusted[i]);
    trusted.push_back({{"id", KeyIdText(keys.ring.trusted[i].id)},
                       {"public_key", text.substr(text.find('\n') + 1, 56)},
                       {"endorsed_by", keys.endorsed_by[i]}});
  }
  const Json j = {{"format", kStoreFormat}, {"trusted", trusted}, {"revoked", keys.ring.revoked}};
  return WriteFileAtomically(layout.keys(), j.dump(1) + "\n");
}

}  // namespace panofix
