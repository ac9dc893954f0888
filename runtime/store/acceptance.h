#pragma once
// Whether a signed bundle is one that this vehicle may take: the questions beyond "who signed it".

#include <cstdint>

#include "common/base/status.h"
#include "common/map/bundle_files.h"
#include "common/sign/utc_time.h"
#include "runtime/store/store_files.h"

namespace panofix {

// kExpired where it is that late by the vehicle's clock, or by what it has seen: a clock that was
// set back does not make an expired release fresh.
[[nodiscard]] Status CheckExpiry(const BundleRelease& release, const StoreState& state,
                                 std::int64_t clock_s = NowUtc_s());
// kWrongMap: of another name. kWrongCamera: made for another picture size, or for a focal length
// that differs by more than 5 %.
[[nodiscard]] Status CheckMeantForUs(const Manifest& manifest, const StoreConfig& config);
// kDowngrade: an older build than the newest seen, or another bundle of the same number.
[[nodiscard]] Status CheckNotOlder(const SignedManifest& bundle, const StoreState& state);

}  // namespace panofix
