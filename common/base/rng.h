#pragma once
// Reproducible random numbers: one stream a unit of work, whatever thread runs it.

#include <cstdint>
#include <string_view>

namespace panofix {

// xoshiro256** seeded through SplitMix64 (Blackman and Vigna, "Scrambled linear pseudorandom number
// generators", 2021) from `seed` and an FNV-1a hash of `stream`, e.g. Rng(7, "train/sift"). The
// distributions are our own because the standard library's differ between implementations.
class Rng {
 public:
  using result_type = std::uint64_t;
  Rng(std::uint64_t seed, std::string_view stream);
  [[nodiscard]] static constexpr std::uint64_t min() { return 0; }
  [[nodiscard]] static constexpr std::uint64_t max() { return ~std::uint64_t{0}; }
  std::uint64_t operator()();
  // Uniform in [0, bound); bound > 0.
  std::uint64_t Below(std::uint64_t bound);
  // Uniform in [0, 1), 53 bits.
  double Uniform();
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  // Standard normal (Box-Muller).
  double Normal();

 private:
  std::uint64_t state_[4];
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace panofix
