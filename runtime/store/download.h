#pragma once
// Packages over the wire: plain HTTP is enough, as nothing that comes this way is trusted.

#include <cstdint>
#include <filesystem>
#include <string>

#include "common/base/status.h"
#include "runtime/store/install.h"

namespace panofix {

struct DownloadOptions {
  std::uint64_t max_bytes = std::uint64_t{64} << 30;
  double timeout_s = 3600;  // for all of it
  double stall_s = 30;      // slower than 1 kB/s for this long ends a try
  int num_tries = 3;
};

struct Downloaded {
  std::filesystem::path file;
  bool was_resumed = false;  // part of it came with an earlier try
};

// Fetches `url` (http, https, file) into the store's downloads folder, from where an earlier try
// stopped if the server says that it is the same file. kNotFound, kEndlessData (too large, or out
// of time), kIo (network; run it again to go on), kNoSpace, kCancelled.
[[nodiscard]] Result<Downloaded> Download(const StoreLayout& layout, const std::string& url,
                                          const DownloadOptions& options);

// Installs from a folder, a .pfb file or the URL of one. A downloaded package goes once it is
// installed or refused; one that was pieced together is fetched anew before it is refused.
[[nodiscard]] Result<InstallReport> InstallFrom(const StoreLayout& layout, const std::string& from,
                                                const InstallOptions& install,
                                                const DownloadOptions& download);

}  // namespace panofix
