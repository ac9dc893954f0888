#include "builder/pipeline/build_plan.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "builder/pipeline/landmark_stage.h"
#include "builder/pipeline/reach.h"
#include "builder/pipeline/release.h"
#include "builder/pipeline/run_report.h"
#include "builder/tiling/quadkey.h"
#include "common/base/log.h"
#include "common/camera/camera.h"
#include "common/image/gray_image.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMostBytes = std::size_t{1} << 32;

std::string ReadWhole(const fs::path& path) {
  const auto bytes = ValueOrThrow(ReadFileBytes(path, kMostBytes));
  return {bytes.begin(), bytes.end()};
}

// As the data set's own format has it, with absolute paths.
Json FeatureOf(const PanoramaRecord& r) {
  const auto path = [](const fs::path& p) {
    return p.empty() ? Json(nullptr) : Json(fs::absolute(p).lexically_normal().string());
  };
  return {{"type", "Feature"},
          {"id", r.id},
          {"geometry",
           {{"type", "Point"},
            {"coordinates", {r.position.lon_deg, r.position.lat_deg, r.position.height_m}}}},
          {"properties",
           {{"image", path(r.image)},
            {"depth", path(r.depth)},
            {"mask", path(r.mask)},
            {"depth_scale", r.depth_scale_m},
            {"heading", r.attitude.heading_deg},
            {"pitch", r.attitude.pitch_deg},
            {"roll", r.attitude.roll_deg},
            {"links", r.links},
            {"captured_at", r.captured_at}}}};
}

// What is in the set and cannot be used goes to its list, before hours are spent.
void CheckHeads(PanoramaSet* set) {
  std::vector<Status> checked(set->panoramas.size());
  tbb::parallel_for(std::size_t{0}, checked.size(),
                    [&](std::size_t i) { checked[i] = CheckPanoramaFiles(set->panoramas[i]); });
  std::vector<PanoramaRecord> good;
  for (std::size_t i = 0; i < checked.size(); ++i) {
    if (checked[i].ok()) {
      good.push_back(std::move(set->panoramas[i]));
    } else {
      set->set_aside.push_back({set->panoramas[i].id, checked[i].message()});
    }
  }
  set->panoramas = std::move(good);
}

Reach ReachOf(const BuildOptions& options) {
  constexpr int kAugmentHops = 2;
  const int hops = options.similarity.dist_max / std::max(1, options.num_views);
  return {std::max(kAugmentHops, hops), std::max(kLandmarkHalo_m, options.similarity.dist_max_m)};
}

void Group(const std::vector<PanoramaRecord>& records, BuildPlan* plan) {
  std::vector<std::string> shard_of, tile_of;
  for (const PanoramaRecord& r : records) {
    shard_of.push_back(Quadkey(r.position, plan->options.shard_level));
    tile_of.push_back(Quadkey(r.position));
    ++plan->shards[shard_of.back()].num_panoramas;
    ++plan->tiles[tile_of.back()].num_panoramas;
  }
  const Reach reach = ReachOf(plan->options);
  for (auto& [shard, in_reach] : ShardsInReach(records, shard_of, shard_of, reach)) {
    in_reach.erase(shard);
    plan->shards[shard].halo.assign(in_reach.begin(), in_reach.end());
  }
  for (const auto& [tile, in_reach] : ShardsInReach(records, tile_of, shard_of, reach))
    plan->tiles[tile].shards.assign(in_reach.begin(), in_reach.end());
}

// Size and time, as make and rsync look at files: content is hashed by the stage itself.
std::string StampOf(const fs::path& path) {
  std::error_code error;
  const auto time = fs::last_write_time(path, error).time_since_epoch().count();
  const auto size = error ? 0 : fs::file_size(path, error);
  return error ? "-\n"
               : Format("%lld %lld\n", static_cast<long long>(time), static_cast<long long>(size));
}

void WriteRecords(const WorkFolder& work, const std::vector<PanoramaRecord>& records,
                  BuildPlan* plan) {
  std::map<std::string, std::string> lines, stamps;
  for (const PanoramaRecord& r : records) {
    const std::string shard = Quadkey(r.position, plan->options.shard_level);
    lines[shard] += FeatureOf(r).dump() + "\n";
    stamps[shard] += StampOf(r.image) + StampOf(r.depth) + StampOf(r.mask);
  }
  for (const auto& [shard, text] : lines) {
    plan->shards[shard].records_sha256 = Sha256Hex(text);
    WriteIfChanged(work.records(shard), text);
    WriteIfChanged(work.stamp(shard), Sha256Hex(text + stamps[shard]) + "\n");
  }
}

Json ToJson(const BuildPlan& plan) {
  Json j;
  j["options"] = Json::parse(FormatOptions(plan.options));
  j["out"] = plan.options.out.string();
  j["vocabulary_sha256"] = plan.vocabulary_sha256;
  j["data_set"] = plan.data_set;
  j["source"] = plan.source;
  j["licence"] = plan.licence;
  j["height_datum"] = plan.height_datum;
  j["num_stated"] = plan.num_stated;
  j["set_aside"] = Json::array();
  for (const SetAside& entry : plan.set_aside)
    j["set_aside"].push_back({{"id", entry.id}, {"reason", entry.reason}});
  j["shards"] = Json::object();
  for (const auto& [key, shard] : plan.shards) {
    j["shards"][key] = {{"num_panoramas", shard.num_panoramas},
                        {"records_sha256", shard.records_sha256},
                        {"halo", shard.halo}};
  }
  j["tiles"] = Json::object();
  for (const auto& [key, tile] : plan.tiles)
    j["tiles"][key] = {{"num_panoramas", tile.num_panoramas}, {"shards", tile.shards}};
  return j;
}

BuildPlan FromJson(const Json& j) {
  BuildPlan plan;
  plan.options = ParseOptions(j.at("options").dump());
  plan.options.out = j.at("out").get<std::string>();
  plan.vocabulary_sha256 = j.at("vocabulary_sha256");
  plan.data_set = j.at("data_set"), plan.source = j.at("source"), plan.licence = j.at("licence");
  plan.height_datum = j.at("height_datum");
  plan.num_stated = j.at("num_stated");
  for (const Json& entry : j.at("set_aside"))
    plan.set_aside.push_back({entry.at("id"), entry.at("reason")});
  for (const auto& [key, value] : j.at("shards").items()) {
    plan.shards[key] = {value.at("num_panoramas"), value.at("records_sha256"),
                        value.at("halo").get<std::vector<std::string>>()};
  }
  for (const auto& [key, value] : j.at("tiles").items()) {
    plan.tiles[key] = {value.at("num_panoramas"),
                       value.at("shards").get<std::vector<std::string>>()};
  }
  return plan;
}

// The release, checked, into the work folder: later stages see the very bytes.
void TakeRelease(const BuildOptions& options, const WorkFolder& work, BuildPlan* plan) {
  if (options.vocabulary.empty()) {
    std::error_code ignored;
    fs::remove(work.release(), ignored);
    return;
  }
  const VocabularyRelease release =
      ReadRelease(options.vocabulary, options.extract.features.root_sift);
  WriteIfChanged(work.release(), release.bytes);
  plan->vocabulary_sha256 = release.sha256;
  // What the map states of its words is what it has.
  plan->options.num_sift_words = static_cast<int>(release.vocabulary.sift.num_words);
  plan->options.num_mser_words = static_cast<int>(release.vocabulary.mser.num_words);
}

}  // namespace

void RefuseTooManySetAside(const BuildPlan& plan, const std::vector<SetAside>& set_aside,
                           std::int64_t num_elsewhere) {
  if (set_aside.empty()) return;
  const auto num_bad = static_cast<std::int64_t>(set_aside.size()) + num_elsewhere;
  const double allowed = plan.options.max_set_aside_share * static_cast<double>(plan.num_stated);
  if (num_bad < plan.num_stated && static_cast<double>(num_bad) <= allowed) return;
  // The list is what helps now.
  RunReport report;
  report.set_aside = set_aside;
  const std::string path = plan.options.out.string() + ".report.json";
  ThrowIfError(WriteFileAtomically(path, report.ToJson()));
  const SetAside& first = set_aside.front();
  throw Error(ErrorCode::kBadData,
              Format("%s: %lld of %lld panoramas are unusable (first: %s: %s; all in %s); mend the "
                     "data set or raise --max-set-aside-share",
                     plan.data_set.c_str(), static_cast<long long>(num_bad),
                     static_cast<long long>(plan.num_stated), first.id.c_str(),
                     first.reason.c_str(), path.c_str()));
}

BuildPlan MakePlan(const BuildOptions& options) {
  (void)ValueOrThrow(ReadCameraYaml(options.camera));
  PanoramaSet set = ValueOrThrow(ReadPanoramaSet(options.panoramas));
  const std::string camera_yaml = ReadWhole(options.camera);
  const WorkFolder work(options.work);
  BuildPlan plan;
  plan.options = options;
  plan.options.panoramas.clear(), plan.options.camera.clear(), plan.options.work.clear();
  plan.options.vocabulary.clear();
  plan.options.out = fs::absolute(options.out).lexically_normal();
  if (plan.options.name.empty()) plan.options.name = plan.options.out.filename().string();
  plan.data_set = fs::absolute(options.panoramas).lexically_normal().string();
  plan.source = set.source, plan.licence = set.licence, plan.height_datum = set.height_datum;
  plan.num_stated = static_cast<std::int64_t>(set.panoramas.size() + set.set_aside.size());
  CheckHeads(&set);
  plan.set_aside = set.set_aside;
  RefuseTooManySetAside(plan, plan.set_aside);
  Group(set.panoramas, &plan);
  ThrowIfError(MakeDirectories(work.root() / "plan", "--work"));
  WriteIfChanged(work.camera(), camera_yaml);
  TakeRelease(options, work, &plan);
  WriteRecords(work, set.panoramas, &plan);
  WriteIfChanged(work.plan(), ToJson(plan).dump(1) + "\n");
  return plan;
}

BuildPlan ReadPlan(const WorkFolder& work) {
  if (!fs::exists(work.plan())) {
    throw Error(ErrorCode::kNotFound, work.plan().string() +
                                          ": no such plan; run panofix-builder plan first, or name "
                                          "its folder for --work");
  }
  const std::string mend = "; run panofix-builder plan again";
  try {
    return FromJson(Json::parse(ReadWhole(work.plan())));
  } catch (const Json::exception& error) {
    throw Error(ErrorCode::kBadData,
                work.plan().string() + ": cannot be used (" + error.what() + ")" + mend);
  } catch (const Error& error) {
    throw Error(error.code(), work.plan().string() + ": " + error.what() + mend);
  }
}

std::vector<PanoramaRecord> ReadRecords(const WorkFolder& work, const BuildPlan& plan,
                                        const std::string& shard) {
  const auto found = plan.shards.find(shard);
  if (found == plan.shards.end()) {
    throw Error(
        ErrorCode::kInvalidArgument,
        "--shard " + shard + ": not in the plan; see \"shards\" in " + work.plan().string());
  }
  const std::string text = ReadWhole(work.records(shard));
  if (Sha256Hex(text) != found->second.records_sha256) {
    throw Error(ErrorCode::kTryAgain, work.records(shard).string() +
                                          ": not the file of this plan; wait for the plan, or run "
                                          "it again");
  }
  std::istringstream stream(text);
  return ValueOrThrow(ParsePanoramaSet(stream, work.records(shard))).panoramas;
}

}  // namespace panofix
