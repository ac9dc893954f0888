#include "builder/ingest/panorama_set.h"

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "builder/ingest/geojson_stream.h"
#include "builder/ingest/panorama_feature.h"
#include "common/base/log.h"
#include "common/image/gray_image.h"

namespace panofix {
namespace {

using nlohmann::json;

// The text where a parse stopped is a number that JSON does not know: NaN, Infinity and their like.
bool StoppedAtNonFinite(std::string_view text, std::size_t byte) {
  const std::string_view around = text.substr(byte > 3 ? byte - 3 : 0, 12);
  for (const char* word : {"NaN", "nan", "Infinity", "inf", "Inf"}) {
    if (around.find(word) != std::string_view::npos) return true;
  }
  return false;
}

struct ParsedJson {
  json value;
  bool ok = false;
  bool is_non_finite = false;  // a number is why it failed
  std::size_t byte = 0;        // 1-based, where it failed
};

ParsedJson ParseJson(std::string_view text) {
  ParsedJson parsed;
  try {
    parsed.value = json::parse(text);
    parsed.ok = true;
  } catch (const json::parse_error& error) {
    parsed.byte = error.byte;
    parsed.is_non_finite = StoppedAtNonFinite(text, error.byte);
  } catch (const json::exception&) {
    parsed.is_non_finite = true;  // out_of_range.406: 1e999
  }
  return parsed;
}

constexpr const char* kNotFinite = "a number is not finite; write a finite number or leave it out";

class SetBuilder {
 public:
  explicit SetBuilder(const std::filesystem::path& path)
      : path_(path), folder_(path.parent_path()) {}

  // A feature of a collection: what is no JSON spoils the file, save for numbers like NaN.
  Status AddFeature(const FeatureText& feature) {
    const std::string name = Format("feature %lld", static_cast<long long>(feature.number));
    const ParsedJson parsed = ParseJson(feature.text);
    if (parsed.ok) {
      Add(parsed.value, name);
    } else if (parsed.is_non_finite) {
      SetAsideAs(name, kNotFinite);
    } else {
      const auto lines = std::count(feature.text.begin(),
                                    feature.text.begin() + static_cast<std::ptrdiff_t>(std::min(
                                                               parsed.byte, feature.text.size())),
                                    '\n');
      return {ErrorCode::kBadData,
              Format("line %lld, byte %lld: not valid JSON (%s); mend or export the file again",
                     static_cast<long long>(feature.line + lines),
                     static_cast<long long>(feature.byte) + static_cast<long long>(parsed.byte) - 1,
                     name.c_str())};
    }
    return {};
  }

  // A record of a sequence: every fault stays its own, but for a header that cannot be used.
  Status AddRecord(const FeatureText& record) {
    const std::string name = Format("line %lld", static_cast<long long>(record.line));
    if (record.is_too_long) {
      SetAsideAs(name, Format("longer than %zu bytes; check the line", kMaxFeatureBytes));
      return {};
    }
    const ParsedJson parsed = ParseJson(record.text);
    if (!parsed.ok) {
      SetAsideAs(name, parsed.is_non_finite
                           ? std::string(kNotFinite)
                           : Format("not valid JSON at its byte %zu; mend the line", parsed.byte));
      return {};
    }
    if (record.number == 1 && IsHeader(parsed.value)) return ReadMembers(parsed.value);
    Add(parsed.value, name);
    return {};
  }

  // The collection around its features, each a 0 there.
  Status ReadFrame(const std::string& text) {
    json frame;
    try {
      frame = json::parse(text);
    } catch (const json::parse_error& error) {
      const auto line =
          1 +
          std::count(text.begin(),
                     text.begin() + static_cast<std::ptrdiff_t>(std::min(error.byte, text.size())),
                     '\n');
      return {ErrorCode::kBadData,
              Format("line %lld: not valid JSON; mend or export the file again",
                     static_cast<long long>(line))};
    } catch (const json::exception&) {
      return {ErrorCode::kBadData, kNotFinite};
    }
    if (!frame.is_object() || frame.value("type", json()) != "FeatureCollection" ||
        !frame.contains("features") || !frame["features"].is_array()) {
      return {ErrorCode::kBadData,
              "no GeoJSON FeatureCollection with \"features\"; export it as one"};
    }
    const json& features = frame["features"];
    for (std::size_t i = 0; i < features.size(); ++i) {
      if (features[i] != 0) SetAsideAs(Format("feature %zu", i + 1), kNotAFeature);
    }
    return ReadMembers(frame);
  }

  Result<PanoramaSet> Finish() {
    for (auto& record : records_) {
      if (num_by_id_[record.id] == 1) {
        set_.panoramas.push_back(std::move(record));
      } else {
        SetAsideAs(record.id, "id is used more than once; give every panorama its own");
      }
    }
    std::sort(set_.panoramas.begin(), set_.panoramas.end(),
              [](const auto& a, const auto& b) { return a.id < b.id; });
    std::sort(set_.set_aside.begin(), set_.set_aside.end(), [](const auto& a, const auto& b) {
      return std::tie(a.id, a.reason) < std::tie(b.id, b.reason);
    });
    if (!set_.panoramas.empty()) return std::move(set_);
    if (set_.set_aside.empty()) {
      return Status(ErrorCode::kBadData, "holds no panorama; give at least one Feature");
    }
    const SetAside& first = set_.set_aside.front();
    return Status(ErrorCode::kBadData,
                  Format("none of its %zu panoramas can be used; %s: %s", set_.set_aside.size(),
                         first.id.c_str(), first.reason.c_str()));
  }

 private:
  static constexpr const char* kNotAFeature = "not a GeoJSON Feature; write \"type\": \"Feature\"";

  static bool IsHeader(const json& value) {
    if (!value.is_object()) return false;
    const auto type = value.find("type");
    return type == value.end() || *type == "FeatureCollection";
  }

  void SetAsideAs(const std::string& id, const std::string& reason) {
    set_.set_aside.push_back({id, reason});
  }

  void Add(const json& feature, const std::string& name) {
    if (!feature.is_object() || feature.value("type", json()) != "Feature") {
      SetAsideAs(name, kNotAFeature);
      return;
    }
    FeatureOutcome outcome = RecordFromFeature(feature, folder_);
    const std::string& id = outcome.record.id;
    if (!id.empty()) ++num_by_id_[id];
    if (outcome.reason.empty()) {
      records_.push_back(std::move(outcome.record));
    } else {
      SetAsideAs(id.empty() ? name : id, outcome.reason);
    }
  }

  Status ReadMembers(const json& object) {
    const std::pair<const char*, std::string*> members[] = {
        {"source", &set_.source}, {"licence", &set_.licence}, {"height_datum", &set_.height_datum}};
    for (const auto& [key, target] : members) {
      const auto found = object.find(key);
      if (found == object.end() || found->is_null()) continue;
      if (!found->is_string()) {
        return {ErrorCode::kBadData, Format("member \"%s\" is not text; write it in quotes", key)};
      }
      *target = found->get<std::string>();
    }
    return {};
  }

  std::filesystem::path path_, folder_;
  PanoramaSet set_;
  std::vector<PanoramaRecord> records_;
  std::map<std::string, int>
      num_by_id_;  // broken features count too: which copy is meant is unknown
};

Status Named(const std::filesystem::path& path, const Status& status) {
  return {status.code(), path.string() + ": " + status.message()};
}

}  // namespace

Result<PanoramaSet> ParsePanoramaSet(std::istream& stream, const std::filesystem::path& path) {
  ByteSource source(stream);
  SetBuilder builder(path);
  Status status;
  if (IsSequence(source)) {
    status =
        SliceSequence(source, [&](const FeatureText& record) { return builder.AddRecord(record); });
  } else {
    std::string frame;
    status = SliceCollection(
        source, [&](const FeatureText& feature) { return builder.AddFeature(feature); }, &frame);
    if (status.ok()) status = builder.ReadFrame(frame);
  }
  if (!status.ok()) return Named(path, status);
  Result<PanoramaSet> set = builder.Finish();
  if (!set.ok()) return Named(path, set.status());
  return set;
}

Result<PanoramaSet> ReadPanoramaSet(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) {
    return Status(ErrorCode::kNotFound, path.string() + ": no such file; check the path");
  }
  if (std::filesystem::is_directory(status)) {
    return Status(ErrorCode::kIo, path.string() + ": a folder; give its panoramas.geojson");
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) {
    return Status(ErrorCode::kIo, path.string() + ": cannot be opened; check its permissions");
  }
  return ParsePanoramaSet(stream, path);
}

}  // namespace panofix
