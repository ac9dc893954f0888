#include "common/base/memory.h"

#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <fstream>
#include <string>

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

void ReturnFreedMemory() { ::malloc_trim(0); }

std::uint64_t PrivateMemoryBytes() {
  std::ifstream file("/proc/self/status");
  std::uint64_t num_kib = 0;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("RssAnon:") || line.starts_with("RssFile:"))
      num_kib += std::stoull(line.substr(sizeof("RssAnon:") - 1));
  }
  return num_kib * 1024;
}

}  // namespace panofix
