#pragma once
// Whether a signed bundle is one that this vehicle may take: the questions beyond "who signed it".

#include <cstdint>

#include "common/base/status.h"
#include "common/map/bundle_files.h"
#include "runtime/store/store_files.h"

namespace panofix {

// The vehicle's clock, but never earlier than what it has seen: a clock that was set back does not
// make an expired release fresh.
[[nodiscard]] std::int64_t TrustedNow_s(const StoreState& state);

// kExpired from `now_s` on.
[[nodiscard]] Status CheckExpiry(const BundleRelease& release, std::int64_t now_s);
// kWrongMap: of another name. kWrongCamera: made for another picture size, or for a focal length
// that differs by more than 5 %.
[[nodiscard]] Status CheckMeantForUs(const Manifest& manifest, const StoreConfig& config);
// kDowngrade: an older build than the newest seen, or another bundle of the same number.
[[nodiscard]] Status CheckNotOlder(const SignedManifest& bundle, const StoreState& state);

}  // namespace panofix
