#pragma once
// The panorama data set: panoramas.geojson or .geojsonl, read as a stream and checked.

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geo/map_frame.h"
#include "common/geometry/attitude.h"

namespace panofix {

// One panorama as the data set states it; paths are resolved against the data set's folder.
struct PanoramaRecord {
  std::string id;
  Geodetic position;
  Attitude attitude;
  std::filesystem::path image, depth, mask;  // depth and mask empty where absent
  double depth_scale_m = 0.001;
  std::vector<std::string> links;
  std::string captured_at;
};

// A panorama that the build leaves out, and why.
struct SetAside {
  std::string id;      // or "line N" / "feature N" where there is none
  std::string reason;  // fault and mend in one line
};

struct PanoramaSet {
  std::vector<PanoramaRecord> panoramas;  // sorted by id: input order changes nothing
  std::vector<SetAside> set_aside;
  std::string source, licence, height_datum = "ellipsoid";
};

// Streams the file (memory: one feature), reading GeoJSON or GeoJSONSeq by content, not by name.
// A feature that breaks a rule (no or duplicate id, latitude out of range, non-finite number, no
// image) is set aside; of a duplicate id every copy is. Links to unknown ids are dropped later, in
// the pipeline. Fails where the file itself cannot be read or parsed, or holds no panorama at all.
[[nodiscard]] Result<PanoramaSet> ReadPanoramaSet(const std::filesystem::path& path);
// The same from an open stream; `path` names it in messages and its folder resolves the records'
// paths.
[[nodiscard]] Result<PanoramaSet> ParsePanoramaSet(std::istream& stream,
                                                   const std::filesystem::path& path);

// The checks that need the panorama's files: image there, JPEG or PNG, width = 2 x height; a stated
// mask there, JPEG or PNG. Cheap: reads headers only. Ok, or the reason to set it aside.
[[nodiscard]] Status CheckPanoramaFiles(const PanoramaRecord& record);

}  // namespace panofix
