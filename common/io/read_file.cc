#include "common/io/read_file.h"

#include <fstream>

#include "common/base/log.h"

namespace panofix {
namespace {

template <typename Bytes>
Result<Bytes> ReadWhole(const std::filesystem::path& path, std::size_t max_bytes) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) {
    return Status(ErrorCode::kNotFound, path.string() + ": no such file; check the path");
  }
  if (!std::filesystem::is_regular_file(status)) {
    return Status(ErrorCode::kIo, path.string() + ": not a file; give the path of a file");
  }
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error) return Status(ErrorCode::kIo, path.string() + ": " + error.message());
  if (size > max_bytes) {
    return Status(ErrorCode::kTooLarge, Format("%s: %ju bytes; at most %zu are read here",
                                               path.c_str(), size, max_bytes));
  }
  std::ifstream file(path, std::ios::binary);
  Bytes bytes(static_cast<std::size_t>(size), {});
  file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!file) {
    return Status(ErrorCode::kIo,
                  path.string() + ": cannot be read; check its permissions and the disk");
  }
  return bytes;
}

}  // namespace

Result<std::vector<std::uint8_t>> ReadFileBytes(const std::filesystem::path& path,
                                                std::size_t max_bytes) {
  return ReadWhole<std::vector<std::uint8_t>>(path, max_bytes);
}

Result<std::string> ReadFileText(const std::filesystem::path& path, std::size_t max_bytes) {
  return ReadWhole<std::string>(path, max_bytes);
}

}  // namespace panofix
