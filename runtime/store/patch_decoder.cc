#include "runtime/store/patch_decoder.h"

#include <zstd.h>

#include <memory>
#include <vector>

#include "common/base/cancel.h"
#include "common/io/mapped_file.h"
#include "common/package/delta_index.h"

namespace panofix {
namespace {

Status Bad(const std::string& fault) {
  return {ErrorCode::kBadData, "patch: " + fault + "; fetch the package again"};
}

}  // namespace

Status ApplyPatch(const StoreLayout& layout, const std::string& base_sha256,
                  std::uint64_t target_bytes, const ReadPatch& read, ObjectWriter* writer) {
  const MappedFile base(layout.object(base_sha256), kMaxPatchedBytes);
  if (!base.is_open()) {
    return {ErrorCode::kIncomplete, "patch: object " + base_sha256.substr(0, 12) +
                                        " that it builds on is not in this store; install the "
                                        "whole bundle"};
  }
  if (target_bytes > kMaxPatchedBytes) return Bad("for an object too large to be patched");
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     &ZSTD_freeDCtx);
  if (context == nullptr ||
      ZSTD_isError(ZSTD_DCtx_setParameter(context.get(), ZSTD_d_windowLogMax,
                                          PatchWindowLog(base.bytes().size(), target_bytes))) !=
          0 ||
      ZSTD_isError(ZSTD_DCtx_refPrefix(context.get(), base.bytes().data(), base.bytes().size())) !=
          0) {
    return {ErrorCode::kInternal, "patch: zstd does not start"};
  }
  std::vector<std::uint8_t> in(ZSTD_DStreamInSize()), out(ZSTD_DStreamOutSize());
  std::size_t left = 1;  // 0 where a frame has ended
  while (true) {
    if (CancelRequested())
      return {ErrorCode::kCancelled, "stopped by the user; run it again to go on"};
    const auto got = read(in);
    if (!got.ok()) return got.status();
    if (*got == 0) break;
    ZSTD_inBuffer input{in.data(), *got, 0};
    while (input.pos < input.size) {
      if (left == 0) return Bad("bytes after its end");
      ZSTD_outBuffer output{out.data(), out.size(), 0};
      left = ZSTD_decompressStream(context.get(), &output, &input);
      if (ZSTD_isError(left) != 0) return Bad(ZSTD_getErrorName(left));
      const Status status = writer->Write(std::span(out).first(output.pos));
      if (!status.ok()) return status;
    }
  }
  // What the decoder still holds after its last input.
  while (left != 0) {
    ZSTD_inBuffer input{nullptr, 0, 0};
    ZSTD_outBuffer output{out.data(), out.size(), 0};
    left = ZSTD_decompressStream(context.get(), &output, &input);
    if (ZSTD_isError(left) != 0) return Bad(ZSTD_getErrorName(left));
    if (output.pos == 0 && left != 0)
      return {ErrorCode::kIncomplete, "patch: cut short; fetch the package again"};
    const Status status = writer->Write(std::span(out).first(output.pos));
    if (!status.ok()) return status;
  }
  return {};
}

}  // namespace panofix
