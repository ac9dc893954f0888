// The half of panorama_set.h that looks at the panoramas' own files.

#include <fstream>

#include "builder/ingest/panorama_set.h"
#include "common/base/log.h"
#include "common/image/gray_image.h"

namespace panofix {
namespace {

// Size of an image file from as few of its bytes as hold it: metadata before a JPEG's size may be
// megabytes, and mostly is not there.
Result<ImageSize> ReadImageFileSize(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    return Status(ErrorCode::kNotFound, path.string() + ": no such file; check the path");
  }
  std::ifstream file(path, std::ios::binary);
  if (!file)
    return Status(ErrorCode::kIo, path.string() + ": cannot be opened; check its permissions");
  constexpr std::size_t kFirstBytes = std::size_t{64} << 10, kLastBytes = std::size_t{64} << 20;
  std::vector<std::uint8_t> bytes;
  for (std::size_t wanted = kFirstBytes;; wanted *= 8) {
    const std::size_t filled = bytes.size();
    bytes.resize(wanted);
    file.read(reinterpret_cast<char*>(bytes.data() + filled),
              static_cast<std::streamsize>(wanted - filled));
    bytes.resize(filled + static_cast<std::size_t>(file.gcount()));
    Result<ImageSize> size = ReadImageSize(bytes);
    if (size.ok()) return size;
    if (bytes.size() < wanted || wanted >= kLastBytes) {
      return Status(size.status().code(), path.string() + ": " + size.status().message());
    }
  }
}

}  // namespace

Status CheckPanoramaFiles(const PanoramaRecord& record) {
  const Result<ImageSize> size = ReadImageFileSize(record.image);
  if (!size.ok()) return size.status();
  if (size->width_px != 2 * size->height_px) {
    return {ErrorCode::kBadData,
            Format("%s: %dx%d is not equirectangular; the width must be twice the height",
                   record.image.c_str(), size->width_px, size->height_px)};
  }
  const std::int64_t num_pixels = static_cast<std::int64_t>(size->width_px) * size->height_px;
  if (num_pixels > DecodeLimits().max_pixels) {
    return {ErrorCode::kTooLarge, Format("%s: %dx%d pixels; scale it to at most %lld pixels",
                                         record.image.c_str(), size->width_px, size->height_px,
                                         static_cast<long long>(DecodeLimits().max_pixels))};
  }
  if (record.mask.empty()) return {};
  // Without its mask the car itself would become landmarks.
  const Result<ImageSize> mask_size = ReadImageFileSize(record.mask);
  return mask_size.ok() ? Status() : mask_size.status();
}

}  // namespace panofix
