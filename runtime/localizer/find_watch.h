#pragma once
// Finds that one frame alone does not make sure of: where the last ones lie along one motion they
// confirm each other.

#include <cstdint>
#include <vector>

#include "common/geometry/rigid3.h"

namespace panofix {

struct FindWatchOptions {
  double max_age_s = 2;        // finds further back say nothing of a motion at one speed
  int min_finds = 3;           // along the motion, the last one included
  double max_off_m = 0.3;      // of a find from the motion
  double max_turn_rad = 0.06;  // likewise: vehicles nod and roll by a degree or two
  double min_way_m = 0.5;      // a camera at rest sees the same wrong pose again and again
  double max_speed_m_per_s = 40;
  double max_turn_rate_rad_per_s = 0.8;
};

// Wrong poses of single frames lie a metre or two from the camera, each elsewhere; right ones move
// as a vehicle does.
class FindWatch {
 public:
  explicit FindWatch(const FindWatchOptions& options = {}) : options_(options) {}
  // Forgets what is too old for a frame at `now_ns`, all where time runs backwards. Call it first
  // for each frame.
  void Advance(std::int64_t now_ns);
  // A find of the frame at `now_ns` that is not sure, as map_from_cam (metres), in place of one
  // that the same frame gave before; `is_firm`: it may confirm others.
  void Add(std::int64_t now_ns, const Rigid3& map_from_cam, bool is_firm);
  // Whether the last find lies with enough of the firm ones, itself included, and with half of them
  // at least, along one motion.
  [[nodiscard]] bool IsConfirmed() const;
  // map_from_cam of the last `most` finds before `now_ns`, latest first.
  [[nodiscard]] std::vector<Rigid3> Before(std::int64_t now_ns, std::size_t most) const;

 private:
  struct Find {
    std::int64_t timestamp_ns;
    Rigid3 map_from_cam;
    bool is_firm;
  };
  // Firm finds along the motion from `first` to the last one, both included; 0 where it is none.
  [[nodiscard]] int CountAlong(const Find& first) const;

  FindWatchOptions options_;
  std::vector<Find> finds_;  // older first
};

}  // namespace panofix
