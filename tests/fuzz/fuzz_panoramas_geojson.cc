// panoramas.geojson and .geojsonl.

#include <cmath>
#include <cstdlib>
#include <sstream>

#include "builder/ingest/panorama_set.h"
#include "tests/fuzz/fuzz_target.h"

namespace panofix {

FuzzCorpus SeedCorpus() {
  const std::string plain =
      R"({"type":"Feature","id":"a","geometry":{"type":"Point","coordinates":[2.3,48.8,40]},)"
      R"("properties":{"image":"a.jpg"}})";
  const std::string full =
      R"({"type":"Feature","id":"b","geometry":{"type":"Point","coordinates":[2.3,48.8,40.5]},)"
      R"("properties":{"image":"b.jpg","depth":"b.gsv","mask":"b.png","heading":12.5,"pitch":-1,)"
      R"("roll":0.5,"depth_scale":0.01,"links":["a"],"captured_at":"2014-06-16T12:31:34Z"}})";
  const std::string members = R"("source":"s \"[{","licence":"l")";
  FuzzCorpus corpus;
  corpus.inputs = {"{\"type\":\"FeatureCollection\"," + members + ",\n\"features\":[\n" + plain +
                       ",\n" + full + "\n]}\n",
                   "{\"features\":[" + full + "," + plain + "],\"type\":\"FeatureCollection\"}",
                   "{" + members + "}\n" + plain + "\n" + full + "\n",
                   "\x1E" + plain + "\n\x1E" + full + "\n"};
  corpus.words = {"{",
                  "}",
                  "[",
                  "]",
                  "\"",
                  "\\",
                  ",",
                  ":",
                  "null",
                  "\n",
                  "\x1E",
                  "1e999",
                  "NaN",
                  "-0.0",
                  "\\u00",
                  "id",
                  "\"features\":[",
                  plain};
  return corpus;
}

}  // namespace panofix

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream stream(std::string(reinterpret_cast<const char*>(data), size));
  const auto set = panofix::ParsePanoramaSet(stream, "fuzz/panoramas.geojson");
  if (!set.ok()) return set.status().message().empty() ? (std::abort(), 0) : 0;
  if (set->panoramas.empty()) std::abort();
  const std::string* last_id = nullptr;
  for (const auto& record : set->panoramas) {
    if (record.id.empty() || record.image.empty()) std::abort();
    if (last_id != nullptr && !(*last_id < record.id)) std::abort();
    if (!(std::abs(record.position.lat_deg) <= 90) || !std::isfinite(record.attitude.heading_deg)) {
      std::abort();
    }
    last_id = &record.id;
  }
  return 0;
}
