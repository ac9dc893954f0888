#pragma once
// What a stage's unit has made: small JSON files that later stages and the next night read.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "builder/ingest/panorama_set.h"
#include "builder/pipeline/key_parts.h"
#include "builder/pipeline/run_report.h"
#include "builder/pipeline/work_folder.h"

namespace panofix {

// What a receipt was made from: "options", "records/0231", "extract/0231" -> SHA-256. A receipt is
// out of date once one of them has another.
using MadeFrom = std::map<std::string, std::string>;

// A work file made for a panorama. Keys name files in the work folder.
struct MadeFile {
  std::string id;
  std::string key;    // empty: nothing to keep
  PartDigests parts;  // what decided it
};

struct ExtractReceipt {
  struct Panorama {
    MadeFile made;
    bool has_depth = false;
  };
  MadeFrom made_from;
  std::vector<Panorama> panoramas;  // usable ones, by id
  std::vector<SetAside> set_aside, without_depth;
};

struct AugmentReceipt {
  struct Panorama {
    MadeFile made;
    std::vector<std::array<double, 3>> stations;  // in its pano frame, metres; itself first
  };
  MadeFrom made_from;
  std::vector<Panorama> panoramas;
};

struct WordsReceipt {
  MadeFrom made_from;
  std::vector<MadeFile> panoramas;
  std::string counts_key;  // views that show each word
};

// One file: a sample, trees, a vocabulary, a tile's similarity rows.
struct FileReceipt {
  MadeFrom made_from;
  std::string key;
  PartDigests parts;
};

// Where the refinement put a panorama; the geotag's own place where it was not moved.
struct RefinedPose {
  RefinementReport report;
  bool is_moved = false;
  std::array<double, 3> geodetic{};       // latitude, longitude (degrees), height (m)
  std::array<double, 4> enu_from_pano{};  // x y z w
};

struct PartFile {
  std::uint64_t num_bytes = 0;  // 0 = there is none
  std::string sha256;
};

struct TileReceipt {
  MadeFrom made_from;
  std::string key;
  PartDigests parts;
  std::int64_t num_landmarks = 0;
  PartFile tile, images;
  std::vector<RefinedPose> refined;  // of the tile's panoramas, in bundle order
};

struct AssembleReceipt {
  struct Part {
    std::string path, file;  // in the bundle; in the work folder
    PartFile content;
  };
  MadeFrom made_from;
  std::vector<Part> parts;
  std::string manifest;  // its text
};

// Writes the receipt of a unit unless it is there already; throws Error.
template <typename Receipt>
void WriteReceipt(const WorkFolder& work, Stage stage, const std::string& unit,
                  const Receipt& receipt);

// What an earlier run left, if it can be used; and its hash.
template <typename Receipt>
[[nodiscard]] std::optional<Receipt> FindReceipt(const WorkFolder& work, Stage stage,
                                                 const std::string& unit);

// For a stage that needs it: Error(kTryAgain) where it is not there, naming the stage to run. Adds
// its hash to `made_from` as "STAGE/UNIT".
template <typename Receipt>
[[nodiscard]] Receipt ReadReceipt(const WorkFolder& work, Stage stage, const std::string& unit,
                                  MadeFrom* made_from);

// How the last run of a unit went, if there was one.
[[nodiscard]] std::optional<UnitReport> FindReport(const WorkFolder& work, Stage stage,
                                                   const std::string& unit);

// SHA-256 of a receipt's file; empty where there is none.
[[nodiscard]] std::string ReceiptSha256(const WorkFolder& work, Stage stage,
                                        const std::string& unit);

// Results that outlive their receipts: what a tile's files hold, beside them.
[[nodiscard]] std::string FormatTile(const TileReceipt& tile);  // without made_from
[[nodiscard]] std::optional<TileReceipt> ParseTile(const std::string& text);

}  // namespace panofix
