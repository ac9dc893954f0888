#include "runtime/store/acceptance.h"

#include <algorithm>
#include <cmath>

#include "common/base/log.h"

namespace panofix {

Status CheckExpiry(const BundleRelease& release, const StoreState& state, std::int64_t clock_s) {
  const ReleaseStatement& s = release.statement;
  const std::int64_t now_s = std::max(clock_s, state.time_floor_s);
  if (now_s < s.expires_s) return {};
  std::string now = "it is " + FormatUtc(now_s);
  if (state.time_floor_s > clock_s) {
    now = "it is " + FormatUtc(now_s) +
          " or later, as a release of that time was installed here (" +
          "time_floor of state.json; the clock says " + FormatUtc(clock_s) + ")";
  }
  return {ErrorCode::kExpired,
          Format("build %lld of '%s' expired at %s, %s; get a newer build, or have this one signed "
                 "again",
                 static_cast<long long>(s.build), s.name.c_str(), FormatUtc(s.expires_s).c_str(),
                 now.c_str())};
}

Status CheckMeantForUs(const Manifest& manifest, const StoreConfig& config) {
  if (manifest.name != config.map_name) {
    return {ErrorCode::kWrongMap, "bundle is of map '" + manifest.name + "', this vehicle takes '" +
                                      config.map_name + "'; get that map's bundle"};
  }
  constexpr double kMaxFocalShare = 0.05;
  const Camera &theirs = manifest.camera, &ours = config.camera;
  const auto differs = [](double a, double b) { return std::abs(a - b) > kMaxFocalShare * b; };
  if (theirs.width_px != ours.width_px || theirs.height_px != ours.height_px ||
      differs(theirs.fx_px, ours.fx_px) || differs(theirs.fy_px, ours.fy_px)) {
    return {ErrorCode::kWrongCamera,
            Format("bundle is for a camera of %dx%d pixels, focal length %.0f, this vehicle's has "
                   "%dx%d and %.0f; get the bundle that was built for it",
                   theirs.width_px, theirs.height_px, theirs.fx_px, ours.width_px, ours.height_px,
                   ours.fx_px)};
  }
  return {};
}

Status CheckNotOlder(const SignedManifest& bundle, const StoreState& state) {
  const std::int64_t build = bundle.manifest.build;
  if (build > state.highest_build || bundle.id == state.highest_id) return {};
  if (build == state.highest_build) {
    return {
        ErrorCode::kDowngrade,
        Format("bundle %.12s says to be build %lld, but that is bundle %.12s; give each release "
               "a number of its own",
               bundle.id.c_str(), static_cast<long long>(build), state.highest_id.c_str())};
  }
  return {ErrorCode::kDowngrade,
          Format("bundle is build %lld, build %lld was here already; get a newer one (to go back "
                 "to the one before: panofix-runtime rollback)",
                 static_cast<long long>(build), static_cast<long long>(state.highest_build))};
}

}  // namespace panofix
