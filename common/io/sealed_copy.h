#pragma once
// A file's bytes in this process's own memory, hashed on the way: what was verified is what is
// used, whatever happens to the file afterwards.

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/io/unique_fd.h"

namespace panofix {

struct SealedCopy {
  UniqueFd fd;         // of memory that nobody can change or cut any more
  std::string sha256;  // of its bytes
};

// Reads `num_bytes` from offset 0 of an open file. kChecksumMismatch where the file has fewer, kIo
// where it cannot be read or memory is short. The memory is taken until the descriptor and the last
// mapping of it are gone.
[[nodiscard]] Result<SealedCopy> CopyToMemory(int fd, std::uint64_t num_bytes,
                                              const std::string& name);

}  // namespace panofix
