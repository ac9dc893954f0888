#pragma once
// What a fuzz target gives the driver beside LLVMFuzzerTestOneInput.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace panofix {

// Well-formed inputs that mutations start from, and pieces of the format worth inserting.
struct FuzzCorpus {
  std::vector<std::string> inputs;
  std::vector<std::string> words;
};
FuzzCorpus SeedCorpus();

}  // namespace panofix
