#pragma once
// The last fixes with the matches they rest on: what the next frame's adjustment is given beside
// its own.

#include <cstdint>
#include <vector>

#include "common/map/map_bundle.h"
#include "runtime/pose/match_pool.h"

namespace panofix {

class PastFrames {
 public:
  // Drops what is older than `max_age_s` at `now_ns`, and all where times run backwards.
  void Advance(std::int64_t now_ns, double max_age_s);
  // A fix to rely on, trusted and not degraded; `matches` in any local frame. Keeps the newest
  // `most`.
  void Add(std::int64_t now_ns, const Rigid3& map_from_cam, std::vector<Correspondence> matches,
           std::size_t most);
  // In `local`, older first. Points are placed from their panorama anew: local frames differ in
  // origin and scale.
  [[nodiscard]] std::vector<PastFrame> InLocal(const MapBundle& bundle,
                                               const LocalFrame& local) const;

 private:
  struct Fix {
    std::int64_t timestamp_ns;
    Rigid3 map_from_cam;
    std::vector<Correspondence> matches;
  };
  std::vector<Fix> fixes_;  // older first
};

}  // namespace panofix
