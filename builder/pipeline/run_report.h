#pragma once
// What a build did, stage by stage: for people as a table, for machines as JSON.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "builder/ingest/panorama_set.h"
#include "builder/pipeline/key_parts.h"

namespace panofix {

// A unit that was made again although an earlier run had made it.
struct Redone {
  std::string id, why;
};

// How full a vocabulary is: words that most views show tell none apart.
struct Saturation {
  std::int64_t num_words = 0, num_used = 0;  // the latter: shown by a view at least
  double mean_share = 0;                     // of the views, that a used word is shown by
  double typical_share = 0;  // the same for a word as views have them: rare ones count less
};
[[nodiscard]] Saturation SaturationOf(std::span<const float> idf);

// What a run of one shard's or tile's stage did.
struct UnitReport {
  std::string stage, unit, run;  // `run` names the plan's run
  double duration_s = 0;
  std::int64_t num_items = 0, num_new = 0, num_redone = 0;  // the rest was there
  std::int64_t num_set_aside = 0;
  std::uint64_t num_bytes_written = 0, peak_memory_bytes = 0;
  std::vector<Redone> redone;  // with the reason
  std::optional<Saturation> saturation;
  std::string result_sha256;  // of the unit's receipt

  // Counts an item as new, or as redone with its reason. `before`: the parts that decided it the
  // last time, of a receipt or missing.
  void AddRedone(const std::string& id, const PartDigests* before, const PartDigests& now);
  [[nodiscard]] std::string ToJson() const;
  [[nodiscard]] static std::optional<UnitReport> Parse(const std::string& json);
};

struct StageReport {
  std::string name;
  double duration_s = 0;  // summed over units
  std::int64_t num_items = 0, num_reused = 0;
  std::string unit;
  std::int64_t num_units = 1, num_units_run = 1;
  std::uint64_t num_bytes_written = 0, peak_memory_bytes = 0;
  std::string result_sha256;  // over all units' results
  std::vector<Redone> redone;
  void Add(const UnitReport& report);
};

// What the joint refinement did to a panorama.
struct RefinementReport {
  std::string id;
  double shift_m = 0, turn_deg = 0;                      // from its geotag
  double residual_before_px = 0, residual_after_px = 0;  // median over its tracks
  int num_tracks = 0;
  bool is_flagged = false;  // its geotag cannot be reconciled; it keeps it and is weighed down
};

struct RunReport {
  std::vector<StageReport> stages;
  std::vector<SetAside> set_aside;        // panoramas left out, with their reasons
  std::vector<SetAside> without_depth;    // panoramas in the map whose depth is missing or unusable
  std::vector<RefinementReport> refined;  // in bundle order
  std::int64_t num_panoramas = 0, num_stations = 0, num_views = 0, num_landmarks = 0;
  std::uint64_t bundle_bytes = 0;
  std::uint64_t peak_memory_bytes = 0;
  std::string bundle_id;           // SHA-256 of the manifest
  std::string vocabulary_release;  // the first twelve digits of its SHA-256
  std::optional<Saturation> saturation;

  [[nodiscard]] std::string ToJson() const;
  [[nodiscard]] std::string ToTable() const;
};

}  // namespace panofix
