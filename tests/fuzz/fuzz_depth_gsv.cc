// .gsv depth: as text, and the payload alone, so that mutations get past base64 and zlib.

#include <cmath>
#include <cstdlib>

#include "builder/ingest/depth_map.h"
#include "builder/ingest/depth_payload.h"
#include "tests/builder/ingest/gsv_writer.h"
#include "tests/fuzz/fuzz_target.h"

namespace panofix {
namespace {

void UseMap(const DepthMap& map) {
  if (map.SurfaceShare() < 0 || map.SurfaceShare() > 1) std::abort();
  const auto ground = map.GroundPlane();
  if (ground && (*ground < 1 || *ground >= static_cast<int>(map.planes().size()))) std::abort();
  for (int row = 0; row < map.height(); row += 1 + map.height() / 16) {
    for (int column = 0; column < map.width(); column += 1 + map.width() / 32) {
      const auto hit = map.CastPixel(column, row);
      if (hit && (!std::isfinite(hit->range_m) || hit->range_m <= 0)) std::abort();
    }
  }
}

}  // namespace

FuzzCorpus SeedCorpus() {
  std::vector<std::uint8_t> plane_idx(16 * 8, 0);
  for (std::size_t i = 64; i < plane_idx.size(); ++i)
    plane_idx[i] = static_cast<std::uint8_t>(1 + i % 2);
  const auto raw = GsvPayload(16, 8, {{}, {0, 0, -1, 2.5F}, {0, 1, 0, 4}}, plane_idx);
  const auto packed = ZlibCompressed(raw);
  FuzzCorpus corpus;
  corpus.inputs = {Base64(raw), Base64(packed, false, true), std::string(raw.begin(), raw.end()),
                   std::string(packed.begin(), packed.end())};
  corpus.words = {"=",
                  "==",
                  "-_",
                  "+/",
                  "\n",
                  std::string("\xFF\xFF", 2),
                  std::string("\0\x01", 2),
                  std::string("\0\0\xC0\x7F", 4)};
  return corpus;
}

}  // namespace panofix

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto as_text = panofix::DepthMap::DecodeGsv({reinterpret_cast<const char*>(data), size});
  if (as_text.ok()) panofix::UseMap(*as_text);
  const auto payload = panofix::ParseDepthPayload({data, size});
  if (!payload.ok()) return 0;
  for (const std::uint8_t idx : payload->plane_idx) {
    if (idx >= payload->planes.size()) std::abort();
  }
  const auto again = panofix::DepthMap::DecodeGsv(panofix::Base64({data, data + size}));
  if (!again.ok()) std::abort();
  panofix::UseMap(*again);
  return 0;
}
