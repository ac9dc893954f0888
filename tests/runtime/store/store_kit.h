#pragma once
// A vehicle's store and signed bundles for it, small and made on the spot.

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "runtime/store/activate.h"
#include "runtime/store/install.h"
#include "runtime/store/store.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/support/test_signer.h"

namespace panofix {

inline const char* const kMapName = "city";

// A crafted bundle of this number; builds differ in one tile and the graph.
[[nodiscard]] CraftedBundle BundleOfBuild(std::int64_t build);

// Entries of a package as the bytes of a .pfb.
using Entries = std::vector<std::pair<std::string, std::string>>;
[[nodiscard]] std::string PackageBytes(const Entries& entries);
// All of a signed bundle's folder.
[[nodiscard]] Entries EntriesOf(const std::filesystem::path& bundle);

class StoreKit : public testing::Test {
 protected:
  StoreKit();

  // The folder of a bundle signed with `signer_`; made once a number.
  std::filesystem::path Bundle(std::int64_t build);
  // Another one, changed before it is written or signed.
  std::filesystem::path BundleWith(
      const std::string& name, std::int64_t build,
      const std::function<void(CraftedBundle*)>& change,
      const std::function<void(ReleaseStatement*)>& change_statement = {});
  [[nodiscard]] Result<InstallReport> InstallFolder(const std::filesystem::path& folder,
                                                    const InstallOptions& options = {}) const;
  [[nodiscard]] Result<InstallReport> InstallPackage(const std::string& bytes) const;
  [[nodiscard]] Status ActivateHere(const std::string& id) const;
  // Installs and activates it; the version's id.
  std::string Run(std::int64_t build);
  [[nodiscard]] StoreState State() const { return ValueOrThrow(ReadStoreState(layout_)); }
  // What a start of the runtime would open: its build. -1 where it would have none.
  [[nodiscard]] std::int64_t BuildInForce() const;
  [[nodiscard]] std::string IdOf(const std::filesystem::path& bundle) const;

  const TempFolder folder_;
  const StoreLayout layout_{folder_ / "store"};
  const TestSigner signer_{1}, other_{2};
};

// A probe that opens the bundle with the store's keys, in this process.
[[nodiscard]] HealthProbe OpeningProbe(const StoreLayout& layout);

// The build that a start of the runtime would open; -1 and a test failure where it is not whole.
[[nodiscard]] std::int64_t OpenedBuild(const StoreLayout& layout);

}  // namespace panofix
