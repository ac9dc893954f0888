#pragma once
// Whether other places of the map explain the last frames nearly as well as the poses found.

namespace panofix {

struct RivalWatchOptions {
  double max_share = 0.35;   // of the poses' support: a rival with more makes a place ambiguous
  double kept = 0.93;        // of the sums, each comparison: about 14 of them count
  int first_frames = 10;     // of a run: compared each time, frames without a pose end a run
  int period_frames = 5;     // afterwards one in so many is compared
  double wary_share = 0.15;  // a rival with more is compared each time
};

// Single frames are too noisy: what is repeated shows in some frames and hides in others, so the
// supports (PoseOutcome::support) of poses and of their best rivals are summed, older ones fade.
// The sums outlive a loss of the pose: a street that was ambiguous stays so until frames enough
// speak for one place.
class RivalWatch {
 public:
  explicit RivalWatch(const RivalWatchOptions& options = {}) : options_(options) {}
  // A new frame has come.
  void Advance();
  // Whether this frame's pose is to be compared with other places.
  [[nodiscard]] bool IsDue() const;
  // A frame's pose has that support, the best pose elsewhere the other.
  void Add(double support, double rival_support);
  // A pose was found and not compared.
  void Pass() { has_pose_ = true; }
  [[nodiscard]] double Share() const { return own_ > 0 ? rival_ / own_ : 0; }
  [[nodiscard]] bool IsAmbiguous() const { return Share() > options_.max_share; }

 private:
  RivalWatchOptions options_;
  double own_ = 0, rival_ = 0;
  int run_frames_ = 0, frames_since_ = 0;
  bool has_pose_ = false;  // the frame before, then this one
};

}  // namespace panofix
