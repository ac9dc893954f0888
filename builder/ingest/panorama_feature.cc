#include "builder/ingest/panorama_feature.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/log.h"

namespace panofix {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxIdBytes = 256;
constexpr std::size_t kMaxPathBytes = 4096;
constexpr std::size_t kMaxLinks = 1024;
constexpr double kMaxHeight_m = 20000;

bool HasControlCharacter(const std::string& text) {
  return std::any_of(text.begin(), text.end(),
                     [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; });
}

// The first fault found; later ones of the same feature are not reported.
class Reader {
 public:
  explicit Reader(const json& properties) : properties_(properties) {}

  // The member's value, `fallback` where it is missing or null.
  double Number(const char* key, double fallback, double low, double high, const char* mend) {
    const json* value = Find(key);
    if (value == nullptr) return fallback;
    if (!value->is_number()) {
      Fail(Format("%s is not a number; %s", key, mend));
      return fallback;
    }
    const double number = value->get<double>();
    if (!(number >= low && number <= high)) Fail(Format("%s is %g; %s", key, number, mend));
    return number;
  }
  // Empty where the member is missing or null.
  std::string Text(const char* key, std::size_t max_bytes, const char* mend) {
    const json* value = Find(key);
    if (value == nullptr) return {};
    if (!value->is_string()) {
      Fail(Format("%s is not text; %s", key, mend));
      return {};
    }
    const auto& text = value->get_ref<const std::string&>();
    if (text.size() > max_bytes || HasControlCharacter(text)) {
      Fail(Format("%s is too long or holds control characters; %s", key, mend));
      return {};
    }
    return text;
  }
  std::vector<std::string> Ids(const char* key) {
    std::vector<std::string> ids;
    const json* value = Find(key);
    if (value == nullptr) return ids;
    const bool all_text =
        value->is_array() && value->size() <= kMaxLinks &&
        std::all_of(value->begin(), value->end(), [](const json& id) { return id.is_string(); });
    if (!all_text) {
      Fail(Format("%s is not a list of at most %zu ids; give the neighbours' ids", key, kMaxLinks));
      return ids;
    }
    for (const json& id : *value) ids.push_back(id.get<std::string>());
    return ids;
  }
  void Fail(const std::string& reason) {
    if (reason_.empty()) reason_ = reason;
  }
  [[nodiscard]] const std::string& reason() const { return reason_; }

 private:
  [[nodiscard]] const json* Find(const char* key) const {
    const auto found = properties_.find(key);
    return found == properties_.end() || found->is_null() ? nullptr : &*found;
  }
  const json& properties_;
  std::string reason_;
};

// Empty where the id is good.
std::string ReadId(const json& feature, std::string* id) {
  const auto found = feature.find("id");
  if (found == feature.end() || found->is_null()) return "no id; give the feature a unique \"id\"";
  if (!found->is_string()) return "id is not text; write it in quotes";
  const auto& text = found->get_ref<const std::string&>();
  if (text.empty()) return "id is empty; give the feature a unique \"id\"";
  if (text.size() > kMaxIdBytes || HasControlCharacter(text)) {
    return Format("id is too long or holds control characters; use at most %zu printable bytes",
                  kMaxIdBytes);
  }
  *id = text;
  return {};
}

std::string ReadPosition(const json& feature, Geodetic* position) {
  constexpr const char* kMend = "give a Point with [lon, lat, height]";
  const auto geometry = feature.find("geometry");
  if (geometry == feature.end() || !geometry->is_object()) return Format("no geometry; %s", kMend);
  const auto type = geometry->find("type");
  if (type == geometry->end() || *type != "Point") return Format("geometry is no Point; %s", kMend);
  const auto coordinates = geometry->find("coordinates");
  if (coordinates == geometry->end() || !coordinates->is_array() || coordinates->size() < 2) {
    return Format("no coordinates; %s", kMend);
  }
  if (coordinates->size() == 2) return Format("no height; %s", kMend);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(*coordinates)[i].is_number()) return Format("coordinates are not numbers; %s", kMend);
  }
  const double lon_deg = (*coordinates)[0].get<double>();
  const double lat_deg = (*coordinates)[1].get<double>();
  const double height_m = (*coordinates)[2].get<double>();
  if (!(std::abs(lat_deg) <= 90)) return Format("latitude is %g; %s in degrees", lat_deg, kMend);
  if (!(std::abs(lon_deg) <= 180)) return Format("longitude is %g; %s in degrees", lon_deg, kMend);
  if (!(std::abs(height_m) <= kMaxHeight_m))
    return Format("height is %g m; %s in metres", height_m, kMend);
  *position = {lat_deg, lon_deg, height_m};
  return {};
}

std::filesystem::path Resolve(const std::filesystem::path& folder, const std::string& text) {
  return text.empty() ? std::filesystem::path() : folder / text;
}

}  // namespace

FeatureOutcome RecordFromFeature(const json& feature, const std::filesystem::path& folder) {
  FeatureOutcome outcome;
  PanoramaRecord& record = outcome.record;
  const std::string id_fault = ReadId(feature, &record.id);
  static const json kNoProperties = json::object();
  const auto found = feature.find("properties");
  const bool has_properties = found != feature.end() && found->is_object();
  Reader reader(has_properties ? *found : kNoProperties);
  const std::string position_fault = ReadPosition(feature, &record.position);
  for (const std::string& fault : {id_fault, position_fault}) {
    if (!fault.empty()) reader.Fail(fault);
  }
  constexpr const char* kPathMend = "give a path from the data set's folder";
  const std::string image = reader.Text("image", kMaxPathBytes, kPathMend);
  if (image.empty()) reader.Fail("no image; give \"image\", the path of a JPEG or PNG");
  record.image = Resolve(folder, image);
  record.depth = Resolve(folder, reader.Text("depth", kMaxPathBytes, kPathMend));
  record.mask = Resolve(folder, reader.Text("mask", kMaxPathBytes, kPathMend));
  constexpr const char* kHeadingMend = "give degrees clockwise from true north, -360 to 360";
  record.attitude.heading_deg = reader.Number("heading", 0, -360, 360, kHeadingMend);
  record.attitude.pitch_deg = reader.Number("pitch", 0, -90, 90, "give degrees, -90 to 90");
  record.attitude.roll_deg = reader.Number("roll", 0, -180, 180, "give degrees, -180 to 180");
  record.depth_scale_m =
      reader.Number("depth_scale", 0.001, 1e-9, 1000, "give the metres of one step, e.g. 0.001");
  record.links = reader.Ids("links");
  record.captured_at = reader.Text("captured_at", 64, "give RFC 3339 text or leave it out");
  outcome.reason = reader.reason();
  return outcome;
}

}  // namespace panofix
