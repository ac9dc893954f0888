// Runs a fuzz target over seeded mutations of its corpus: what libFuzzer does, less the coverage,
// for compilers without it. The same arguments give the same inputs.
//   fuzz_NAME [COUNT [SEED]]   mutated inputs, default 2000 from seed 1
//   fuzz_NAME FILE             one input, e.g. a crash that libFuzzer found

#include <charconv>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>

#include "common/base/rng.h"
#include "tests/fuzz/fuzz_target.h"

namespace panofix {
namespace {

constexpr std::size_t kMaxInputBytes = std::size_t{1} << 20;

void Run(const std::string& input) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(input.data()), input.size());
}

std::size_t Position(Rng& rng, const std::string& input) {
  return static_cast<std::size_t>(rng.Below(input.size() + 1));
}

void Mutate(Rng& rng, const FuzzCorpus& corpus, std::string* input) {
  const std::size_t at = Position(rng, *input);
  const std::size_t length = static_cast<std::size_t>(rng.Below(64));
  switch (rng.Below(8)) {
    case 0:
    case 1:  // a byte
      if (at < input->size()) (*input)[at] = static_cast<char>(rng.Below(256));
      break;
    case 2:  // a bit
      if (at < input->size()) (*input)[at] = static_cast<char>((*input)[at] ^ (1 << rng.Below(8)));
      break;
    case 3:
      input->resize(at);
      break;
    case 4:
      input->erase(at, length);
      break;
    case 5:  // a piece again
      if (input->size() < kMaxInputBytes)
        input->insert(at, input->substr(Position(rng, *input), length));
      break;
    case 6:
      if (!corpus.words.empty()) input->insert(at, corpus.words[rng.Below(corpus.words.size())]);
      break;
    default: {  // the head of one, the tail of another
      const std::string& other = corpus.inputs[rng.Below(corpus.inputs.size())];
      *input = input->substr(0, at) + other.substr(Position(rng, other));
      break;
    }
  }
}

void RunMutations(std::uint64_t count, std::uint64_t seed) {
  const FuzzCorpus corpus = SeedCorpus();
  for (const std::string& input : corpus.inputs) Run(input);
  Rng rng(seed, "fuzz/driver");
  for (std::uint64_t i = 0; i < count; ++i) {
    std::string input = corpus.inputs[rng.Below(corpus.inputs.size())];
    for (std::uint64_t changes = 1 + rng.Below(4); changes > 0; --changes)
      Mutate(rng, corpus, &input);
    Run(input);
  }
  std::printf("%llu inputs\n", static_cast<unsigned long long>(count + corpus.inputs.size()));
}

bool ParseNumber(const std::string& text, std::uint64_t* number) {
  const auto result = std::from_chars(text.data(), text.data() + text.size(), *number);
  return result.ec == std::errc() && result.ptr == text.data() + text.size();
}

}  // namespace
}  // namespace panofix

int main(int argc, char** argv) {
  std::uint64_t count = 2000, seed = 1;
  if (argc > 1 && !panofix::ParseNumber(argv[1], &count)) {
    std::ifstream file(argv[1], std::ios::binary);
    if (!file) {
      std::fprintf(stderr, "%s: cannot be read; give a count or an input file\n", argv[1]);
      return 66;
    }
    panofix::Run(std::string(std::istreambuf_iterator<char>(file), {}));
    return 0;
  }
  if (argc > 2 && !panofix::ParseNumber(argv[2], &seed)) {
    std::fprintf(stderr, "seed '%s' is not a number\n", argv[2]);
    return 64;
  }
  panofix::RunMutations(count, seed);
  return 0;
}
