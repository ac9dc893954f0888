#pragma once
// Work done ahead on idle processors without a say in the outcome.

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace panofix {

// take(make(i)) for i = 0, 1, ... below `count` as long as is_wanted() holds, which is asked before
// each. Makes as many at once as there are processors and drops what is no longer wanted: `take`
// sees the same for any number of processors. `make` runs on several threads at once and must not
// depend on what was taken; `take` and `is_wanted` run on this one. Made has a default value.
template <typename Made, typename IsWanted, typename Make, typename Take>
void MakeInOrder(std::size_t count, const IsWanted& is_wanted, const Make& make, const Take& take) {
  const std::size_t at_once =
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  std::vector<Made> made;
  for (std::size_t first = 0; first < count && is_wanted(); first += made.size()) {
    made.assign(std::min(at_once, count - first), {});
    tbb::parallel_for(std::size_t{0}, made.size(),
                      [&](std::size_t k) { made[k] = make(first + k); });
    for (std::size_t k = 0; k < made.size() && is_wanted(); ++k) take(std::move(made[k]));
  }
}

}  // namespace panofix
