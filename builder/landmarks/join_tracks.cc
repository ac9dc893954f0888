// Matches into tracks: union-find that keeps one landmark a panorama.
#include <numeric>
#include <tuple>

#include "builder/landmarks/match_tracks.h"

namespace panofix {
namespace {

class TrackForest {
 public:
  explicit TrackForest(std::vector<LandmarkRef> refs)
      : parents_(refs.size()), members_(refs.size()) {
    std::iota(parents_.begin(), parents_.end(), std::size_t{0});
    for (std::size_t i = 0; i < refs.size(); ++i) members_[i] = {refs[i]};
  }

  void Join(std::size_t a, std::size_t b) {
    a = Root(a), b = Root(b);
    if (a == b || HaveCommonPanorama(members_[a], members_[b])) return;
    std::vector<LandmarkRef> joined;
    std::merge(members_[a].begin(), members_[a].end(), members_[b].begin(), members_[b].end(),
               std::back_inserter(joined));
    members_[a] = std::move(joined);
    members_[b].clear();
    parents_[b] = a;
  }

  [[nodiscard]] std::vector<Track> Tracks() {
    std::vector<Track> tracks;
    for (auto& members : members_) {
      if (members.size() >= 2) tracks.push_back({std::move(members)});
    }
    std::sort(tracks.begin(), tracks.end(),
              [](const Track& a, const Track& b) { return a.members.front() < b.members.front(); });
    return tracks;
  }

 private:
  std::size_t Root(std::size_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }
  static bool HaveCommonPanorama(const std::vector<LandmarkRef>& a,
                                 const std::vector<LandmarkRef>& b) {
    for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
      if (i->panorama == j->panorama) return true;
      i->panorama < j->panorama ? ++i : ++j;
    }
    return false;
  }

  std::vector<std::size_t> parents_;
  std::vector<std::vector<LandmarkRef>> members_;  // of a root, ascending
};

}  // namespace

std::vector<Track> JoinTracks(std::vector<TrackMatch> matches) {
  std::vector<LandmarkRef> refs;
  for (const TrackMatch& m : matches) refs.insert(refs.end(), {m.a, m.b});
  std::sort(refs.begin(), refs.end());
  refs.erase(std::unique(refs.begin(), refs.end()), refs.end());
  std::sort(matches.begin(), matches.end(), [](const TrackMatch& a, const TrackMatch& b) {
    return std::tie(a.distance_sq, a.a, a.b) < std::tie(b.distance_sq, b.a, b.b);
  });
  const auto index_of = [&](LandmarkRef ref) {
    return static_cast<std::size_t>(std::lower_bound(refs.begin(), refs.end(), ref) - refs.begin());
  };
  TrackForest forest(refs);
  for (const TrackMatch& m : matches) forest.Join(index_of(m.a), index_of(m.b));
  return forest.Tracks();
}

}  // namespace panofix
