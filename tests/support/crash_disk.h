#pragma once
// A file system that fails when told to: this program's calls that change files go through here on
// their way to the C library, are counted, and at a chosen one the power goes, the process is
// killed, or the disk is full. Link it into a test program and arm it in a forked child.

#include <cstdint>

namespace panofix {

struct CrashPlan {
  enum class Kind {
    kKill,       // the process ends; what it wrote stays
    kPowerLoss,  // the process ends; what was not flushed is lost: files are cut to half, and of
                 // the renames, links and new names in folders not flushed since only the first
                 // ones hold
    kDiskFull,  // this call and all later ones that need space fail with ENOSPC
    kIoError,   // this one call fails with EIO
  };
  Kind kind = Kind::kKill;
  std::int64_t at_call = 0;  // from 1; 0 = never, calls are counted only
  std::uint64_t seed = 1;    // how many unflushed renames hold
};

// From now on, in this process. It does not forget what is armed.
void ArmCrash(const CrashPlan& plan);
[[nodiscard]] std::int64_t NumDiskCalls();
// What a child that ended by plan exits with.
inline constexpr int kCrashExitCode = 86;

}  // namespace panofix
