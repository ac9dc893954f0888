#include "runtime/localizer/levers.h"

#include <algorithm>
#include <stdexcept>

namespace panofix {
namespace {

struct Lever {
  const char* name;
  bool Levers::*member;
  std::vector<const char*> needs;
  const char* meaning;
};

// In the order in which an ablation adds them.
const std::vector<Lever>& AllLevers() {
  static const std::vector<Lever> levers = {
      {"mutual",
       &Levers::mutual,
       {},
       "SIFT matches that are each other's nearest, instead of kVLD (needs no view images)"},
      {"ranked",
       &Levers::ranked,
       {},
       "the best views of the window are matched, not the best one's row of D_DB x r"},
      {"pooled",
       &Levers::pooled,
       {},
       "all views' matches as one 2D-3D problem, LO-RANSAC with P3P, no EPnP"},
      {"sigmas", &Levers::sigmas, {}, "residuals weighed by the errors of keypoint, point and map"},
      {"gates",
       &Levers::gates,
       {"pooled"},
       "spread of the inliers, rivals elsewhere, residuals, height, tilt, stated sigma"},
      {"votes", &Levers::votes, {}, "landmarks vote beside the words (RootSIFT maps)"},
      {"guided",
       &Levers::guided,
       {"pooled", "sigmas", "gates"},
       "landmarks are looked for where a pose puts them, and weighed against decoys (RootSIFT "
       "maps)"},
      {"tracking",
       &Levers::tracking,
       {"ranked", "guided"},
       "the last fixes predict the next pose, a filter of places the window"},
      {"bridging",
       &Levers::bridging,
       {"tracking"},
       "where the map shows too little, what the last frames saw carries the pose on"},
      {"coarse",
       &Levers::coarse,
       {"tracking"},
       "a tracked frame is looked at at half its size first, and at full size where that leaves "
       "doubt"},
      {"confirm",
       &Levers::confirm,
       {"tracking"},
       "a find that is not sure is looked at with the landmarks of more stations, and taken where "
       "three finds of two seconds lie along one motion"},
      {"exhaustive",
       &Levers::exhaustive,
       {},
       "every frame is looked up in the whole map: no window, no prediction"},
  };
  return levers;
}

const Lever& LeverOf(const std::string& name) {
  const auto& all = AllLevers();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Lever& lever) { return name == lever.name; });
  if (found != all.end()) return *found;
  std::string known;
  for (const Lever& lever : all) known += (known.empty() ? "" : ", ") + std::string(lever.name);
  throw std::invalid_argument("add = '" + name + "': no such lever; there are " + known);
}

}  // namespace

Levers ResolveLevers(const std::string& preset, const std::vector<std::string>& add) {
  if (preset != "default" && preset != "paper")
    throw std::invalid_argument("preset = '" + preset + "'; must be default or paper");
  Levers levers;
  for (const Lever& lever : AllLevers())
    levers.*lever.member = preset == "default" && lever.member != &Levers::exhaustive;
  for (const std::string& name : add) levers.*LeverOf(name).member = true;
  for (const Lever& lever : AllLevers()) {
    for (const char* need : levers.*lever.member ? lever.needs : std::vector<const char*>{}) {
      if (!(levers.*LeverOf(need).member)) {
        throw std::invalid_argument("add = '" + std::string(lever.name) + "' stands on '" + need +
                                    "'; add that too");
      }
    }
  }
  return levers;
}

std::string LeverHelp() {
  std::string help;
  for (const Lever& lever : AllLevers()) {
    help += "  " + std::string(lever.name) + ": " + lever.meaning;
    for (std::size_t i = 0; i < lever.needs.size(); ++i)
      help += (i == 0 ? "; needs " : ", ") + std::string(lever.needs[i]);
    help += "\n";
  }
  return help;
}

}  // namespace panofix
