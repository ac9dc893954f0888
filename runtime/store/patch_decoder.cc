#include "runtime/store/patch_decoder.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <zstd.h>

#include <memory>
#include <vector>

#include "common/base/cancel.h"
#include "common/package/delta_index.h"

namespace panofix {
namespace {

// A file as memory, read-only.
class MappedFile {
 public:
  explicit MappedFile(const std::filesystem::path& path)
      : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK)) {
    struct stat info {};
    if (!fd_.valid() || ::fstat(fd_.get(), &info) != 0 || !S_ISREG(info.st_mode)) return;
    size_ = static_cast<std::size_t>(info.st_size);
    if (size_ > kMaxPatchedBytes) return;
    is_open_ = true;
    if (size_ == 0) return;
    data_ = ::mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, fd_.get(), 0);
    is_open_ = data_ != MAP_FAILED;
  }
  ~MappedFile() {
    if (is_open_ && size_ > 0) ::munmap(data_, size_);
  }
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  [[nodiscard]] bool is_open() const { return is_open_; }
  [[nodiscard]] const void* data() const { return data_; }
  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  UniqueFd fd_;
  void* data_ = nullptr;
  std::size_t size_ = 0;
  bool is_open_ = false;
};

Status Bad(const std::string& fault) {
  return {ErrorCode::kBadData, "patch: " + fault + "; fetch the package again"};
}

}  // namespace

Status ApplyPatch(const StoreLayout& layout, const std::string& base_sha256,
                  std::uint64_t target_bytes, const ReadPatch& read, ObjectWriter* writer) {
  const MappedFile base(layout.object(base_sha256));
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
                                          PatchWindowLog(base.size(), target_bytes))) != 0 ||
      ZSTD_isError(ZSTD_DCtx_refPrefix(context.get(), base.data(), base.size())) != 0) {
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
