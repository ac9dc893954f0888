#include "common/base/memory.h"

#include <sys/resource.h>
#include <unistd.h>

#include <fstream>

namespace panofix {

std::uint64_t PeakMemoryBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

std::uint64_t ResidentMemoryBytes() {
  std::ifstream file("/proc/self/statm");
  std::uint64_t num_pages = 0, num_resident = 0;
  if (!(file >> num_pages >> num_resident)) return 0;
  return num_resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

}  // namespace panofix
