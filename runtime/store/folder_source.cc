#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "common/base/cancel.h"
#include "common/io/read_file.h"
#include "common/map/manifest.h"
#include "runtime/store/bundle_source.h"
#include "runtime/store/object_pool.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// All of the file, block by block.
Status Copy(const fs::path& path, int fd, ObjectWriter* writer) {
  std::vector<std::uint8_t> block(std::size_t{1} << 20);
  while (true) {
    if (CancelRequested())
      return {ErrorCode::kCancelled, "stopped by the user; run it again to go on"};
    const ssize_t got = ::read(fd, block.data(), block.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) {
      return {ErrorCode::kIo,
              path.string() + ": cannot be read (" + std::strerror(errno) + "); check the medium"};
    }
    if (got == 0) return {};
    const Status status = writer->Write(std::span(block).first(static_cast<std::size_t>(got)));
    if (!status.ok()) return status;
  }
}

class FolderSource : public BundleSource {
 public:
  explicit FolderSource(const fs::path& folder) : folder_(folder), name_(folder.string()) {}
  const std::string& name() const override { return name_; }

  Result<BundleOffer> ReadOffer() override {
    BundleOffer offer;
    auto text = ReadFileText(folder_ / kManifestName, kMaxManifestBytes);
    if (!text.ok()) return text.status();
    offer.manifest_text = std::move(*text);
    if (!fs::exists(folder_ / kManifestSignatureName)) return offer;  // refused for that, later
    auto signature = ReadFileText(folder_ / kManifestSignatureName, kMaxSignatureBytes);
    if (!signature.ok()) return signature.status();
    offer.signature_text = std::move(*signature);
    return offer;
  }

  Status Deliver(const StoreLayout& layout, const std::map<std::string, std::uint64_t>& lacking,
                 const std::map<std::string, std::string>& parts) override {
    for (const auto& [sha256, num_bytes] : lacking) {
      const fs::path path = folder_ / parts.at(sha256);
      const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
      const UniqueFd file(fd);
      struct stat info {};
      if (!file.valid() || ::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        return {ErrorCode::kIncomplete,
                path.string() + ": is missing; fetch the whole bundle again"};
      }
      auto writer = ObjectWriter::Begin(layout, sha256, num_bytes);
      if (!writer.ok()) return writer.status();
      Status status = Copy(path, fd, writer->get());
      if (status.ok()) status = (*writer)->Commit();
      if (!status.ok()) return {status.code(), path.string() + ": " + status.message()};
    }
    return {};
  }

 private:
  const fs::path folder_;
  const std::string name_;
};

}  // namespace

std::unique_ptr<BundleSource> MakeFolderSource(const fs::path& folder) {
  return std::make_unique<FolderSource>(folder);
}

}  // namespace panofix
