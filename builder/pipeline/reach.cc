#include "builder/pipeline/reach.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

using Links = std::vector<std::vector<std::uint32_t>>;

Links BothWays(const std::vector<PanoramaRecord>& records) {
  std::unordered_map<std::string, std::uint32_t> index_of;
  for (std::uint32_t i = 0; i < records.size(); ++i) index_of.emplace(records[i].id, i);
  Links links(records.size());
  for (std::uint32_t i = 0; i < records.size(); ++i) {
    for (const std::string& id : records[i].links) {
      const auto found = index_of.find(id);
      if (found == index_of.end() || found->second == i) continue;
      links[i].push_back(found->second);
      links[found->second].push_back(i);
    }
  }
  return links;
}

// Panoramas by cell of `size_m`. Metres are never overstated: parallels are taken as short as on
// the highest latitude.
class Cells {
 public:
  Cells(const std::vector<PanoramaRecord>& records, double size_m) {
    constexpr double kMetresPerDegree = 111000;  // at most what it is anywhere, within a share
    double shortest = 1;
    for (const PanoramaRecord& r : records)
      shortest = std::min(shortest, std::cos(r.position.lat_deg * kRadPerDeg));
    for (const PanoramaRecord& r : records) {
      const double east_deg =
          AngleDifferenceDeg(r.position.lon_deg, records.front().position.lon_deg);
      at_.emplace_back(
          static_cast<std::int64_t>(std::floor(east_deg * kMetresPerDegree * shortest / size_m)),
          static_cast<std::int64_t>(std::floor(r.position.lat_deg * kMetresPerDegree / size_m)));
    }
    for (std::uint32_t i = 0; i < records.size(); ++i) members_[at_[i]].push_back(i);
  }
  template <typename Visit>
  void VisitAround(std::uint32_t centre, const Visit& visit) const {
    const auto [x, y] = at_[centre];
    for (std::int64_t dx = -1; dx <= 1; ++dx) {
      for (std::int64_t dy = -1; dy <= 1; ++dy) {
        const auto cell = members_.find({x + dx, y + dy});
        if (cell == members_.end()) continue;
        for (const std::uint32_t i : cell->second) visit(i);
      }
    }
  }

 private:
  std::vector<std::pair<std::int64_t, std::int64_t>> at_;
  std::map<std::pair<std::int64_t, std::int64_t>, std::vector<std::uint32_t>> members_;
};

}  // namespace

std::map<std::string, std::set<std::string>> ShardsInReach(
    const std::vector<PanoramaRecord>& records, const std::vector<std::string>& group_of,
    const std::vector<std::string>& shard_of, const Reach& reach) {
  std::map<std::string, std::set<std::string>> result;
  if (records.empty()) return result;
  constexpr double kMargin = 1.05;  // degrees of latitude and longitude differ in length by 1 %
  const Links links = BothWays(records);
  const Cells cells(records, kMargin * reach.metres);
  std::map<std::string, std::vector<std::uint32_t>> members;
  for (std::uint32_t i = 0; i < records.size(); ++i) members[group_of[i]].push_back(i);
  std::vector<std::uint32_t> seen_by(records.size(), 0);
  std::uint32_t group_number = 0;
  for (const auto& [group, own] : members) {
    ++group_number;
    std::set<std::string>& shards = result[group];
    std::vector<std::uint32_t> found = own;
    for (const std::uint32_t i : own) {
      seen_by[i] = group_number;
      cells.VisitAround(i, [&](std::uint32_t other) { shards.insert(shard_of[other]); });
    }
    std::size_t begin = 0;
    for (int hop = 0; hop < reach.hops; ++hop) {
      const std::size_t end = found.size();
      for (; begin < end; ++begin) {
        for (const std::uint32_t next : links[found[begin]]) {
          if (seen_by[next] == group_number) continue;
          seen_by[next] = group_number;
          found.push_back(next);
        }
      }
    }
    for (const std::uint32_t i : found) shards.insert(shard_of[i]);
  }
  return result;
}

}  // namespace panofix
