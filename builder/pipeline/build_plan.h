#pragma once
// What a build is made of, fixed before the work starts: options, shards, tiles and their halos.

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "builder/ingest/panorama_set.h"
#include "builder/pipeline/build_options.h"
#include "builder/pipeline/work_folder.h"

namespace panofix {

struct PlanShard {
  std::int64_t num_panoramas = 0;
  std::string records_sha256;     // of its file of records
  std::vector<std::string> halo;  // shards with panoramas in reach of its own; itself left out
};

struct PlanTile {
  std::int64_t num_panoramas = 0;
  std::vector<std::string> shards;  // with its panoramas or some in reach of them
};

struct BuildPlan {
  BuildOptions options;           // its paths are empty but for `out`
  std::string vocabulary_sha256;  // of the release to use; empty = a vocabulary is trained
  std::string data_set;           // its file
  std::string source, licence, height_datum;
  std::int64_t num_stated = 0;              // panoramas of the data set, good or bad
  std::vector<SetAside> set_aside;          // before anything is decoded
  std::map<std::string, PlanShard> shards;  // by quadkey
  std::map<std::string, PlanTile> tiles;

  [[nodiscard]] std::int64_t num_panoramas() const {
    return num_stated - static_cast<std::int64_t>(set_aside.size());
  }
};

// Reads the data set, looks at the heads of all its files, and writes plan.json with files of
// records and stamps a shard, the camera and the vocabulary release into the work folder. Files
// that would not change are left alone. Throws Error: kBadData where more panoramas are unusable
// than `max_set_aside_share`; the list is then in OUT.report.json.
BuildPlan MakePlan(const BuildOptions& options);

[[nodiscard]] BuildPlan ReadPlan(const WorkFolder& work);
// Records of one shard, by id. Throws Error.
[[nodiscard]] std::vector<PanoramaRecord> ReadRecords(const WorkFolder& work, const BuildPlan& plan,
                                                      const std::string& shard);

// Throws Error(kBadData) where `set_aside`, and `num_elsewhere` more, are more than the allowed
// share of the data set.
void RefuseTooManySetAside(const BuildPlan& plan, const std::vector<SetAside>& set_aside,
                           std::int64_t num_elsewhere = 0);

}  // namespace panofix
