#include "builder/pipeline/build_options.h"

#include <stdexcept>

#include "common/base/log.h"

namespace panofix {

void BuildOptions::Check() const {
  const auto require = [](bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument(message);
  };
  require(num_views >= 1 && num_views <= 64,
          Format("num_views = %d; must lie in 1..64", num_views));
  require(view_pitch_deg > -80 && view_pitch_deg < 80,
          Format("view_pitch_deg = %g; must lie in (-80, 80)", view_pitch_deg));
  require(num_sift_words >= 2, Format("num_sift_words = %d; must be at least 2", num_sift_words));
  require(num_mser_words >= 2, Format("num_mser_words = %d; must be at least 2", num_mser_words));
  require(max_words >= 0, Format("max_words = %d; must not be negative", max_words));
  require(build >= 0, "build must not be negative");
  require(max_set_aside_share >= 0 && max_set_aside_share <= 1,
          Format("max_set_aside_share = %g; must lie in [0, 1]", max_set_aside_share));
  require(shard_level >= 1 && shard_level <= 23,
          Format("shard_level = %d; must lie in 1..23", shard_level));
  require(num_threads >= 0, Format("num_threads = %d; must not be negative", num_threads));
  extract.Check();
  similarity.Check();
  stations.Check();
  render.Check();
  landmarks.Check();
}

}  // namespace panofix
