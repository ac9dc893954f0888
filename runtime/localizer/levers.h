#pragma once
// What the default preset has over the published method, piece by piece: for ablations.

#include <string>
#include <vector>

namespace panofix {

// All false: the paper's on-line part to the letter.
struct Levers {
  bool mutual = false, ranked = false, pooled = false, sigmas = false, gates = false;
  bool votes = false, guided = false, tracking = false, bridging = false;
  bool coarse = false, confirm = false;
  bool exhaustive = false;  // no preset's: what a window spares is measured against it
};

// The levers of preset "paper" (none) or "default", and those of `add`. Throws
// std::invalid_argument on an unknown name, and where a lever lacks one that it stands on.
[[nodiscard]] Levers ResolveLevers(const std::string& preset, const std::vector<std::string>& add);

// Name and meaning of each, a line each.
[[nodiscard]] std::string LeverHelp();

}  // namespace panofix
