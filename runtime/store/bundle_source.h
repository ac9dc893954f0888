#pragma once
// Where a bundle comes from: a folder, or a .pfb package that holds all of it or what changed.

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "runtime/store/store_files.h"

namespace panofix {

// A public key with its endorsement, as bytes.
struct OfferedKey {
  std::string key_text, signature_text;
};

// What a source says that it has; nothing of it is trusted yet.
struct BundleOffer {
  std::string manifest_text, signature_text;
  std::vector<OfferedKey> keys;
};

class BundleSource {
 public:
  virtual ~BundleSource() = default;
  // For messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
  [[nodiscard]] virtual Result<BundleOffer> ReadOffer() = 0;
  // Puts the objects of `lacking` (SHA-256 and size, from a verified manifest) into the store's
  // pool, as far as the source has them. After ReadOffer, once. `parts` names each for messages and
  // for folders.
  [[nodiscard]] virtual Status Deliver(const StoreLayout& layout,
                                       const std::map<std::string, std::uint64_t>& lacking,
                                       const std::map<std::string, std::string>& parts) = 0;
};

// A bundle's folder as the builder leaves it.
[[nodiscard]] std::unique_ptr<BundleSource> MakeFolderSource(const std::filesystem::path& folder);
// A .pfb package, read once from front to end.
[[nodiscard]] std::unique_ptr<BundleSource> MakePackageSource(const std::filesystem::path& file);

}  // namespace panofix
