#include "builder/ship/patch.h"

#include <zstd.h>

#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/package/delta_index.h"

namespace panofix {
namespace {

constexpr int kLevel = 3;  // higher ones find no more between two versions, and take for ever
constexpr double kWorthwhileShare = 0.8;

void Require(std::size_t zstd_result) {
  if (ZSTD_isError(zstd_result) != 0) {
    throw Error(ErrorCode::kInternal,
                std::string("patch: zstd: ") + ZSTD_getErrorName(zstd_result));
  }
}

}  // namespace

std::vector<std::uint8_t> MakePatch(std::span<const std::uint8_t> base,
                                    std::span<const std::uint8_t> target) {
  if (base.size() > kMaxPatchedBytes || target.size() > kMaxPatchedBytes) return {};
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                     &ZSTD_freeCCtx);
  if (context == nullptr) throw Error(ErrorCode::kInternal, "patch: zstd does not start");
  const auto set = [&](ZSTD_cParameter parameter, int value) {
    Require(ZSTD_CCtx_setParameter(context.get(), parameter, value));
  };
  set(ZSTD_c_compressionLevel, kLevel);
  set(ZSTD_c_windowLog, PatchWindowLog(base.size(), target.size()));
  set(ZSTD_c_enableLongDistanceMatching, 1);
  Require(ZSTD_CCtx_refPrefix(context.get(), base.data(), base.size()));
  std::vector<std::uint8_t> patch(ZSTD_compressBound(target.size()));
  const std::size_t size =
      ZSTD_compress2(context.get(), patch.data(), patch.size(), target.data(), target.size());
  Require(size);
  if (static_cast<double>(size) > kWorthwhileShare * static_cast<double>(target.size())) return {};
  patch.resize(size);
  return patch;
}

}  // namespace panofix
