#include "common/features/matcher.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <limits>
#include <stdexcept>

#include "common/base/log.h"
#include "common/features/features.h"

namespace panofix {
namespace {

constexpr std::size_t kSize = kDescriptorSize;
using Wide = std::vector<std::int16_t>;

Wide Widen(std::span<const std::uint8_t> bytes) { return {bytes.begin(), bytes.end()}; }

int SquaredNorm(const std::int16_t* a) {
  int sum = 0;
  for (std::size_t i = 0; i < kSize; ++i) sum += a[i] * a[i];
  return sum;
}

// Inner products of one descriptor with `count` others.
void DotsPortable(const std::int16_t* a, const std::int16_t* others, std::size_t count, int* dots) {
  for (std::size_t j = 0; j < count; ++j) {
    int sum = 0;
    for (std::size_t i = 0; i < kSize; ++i) sum += a[i] * others[j * kSize + i];
    dots[j] = sum;
  }
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) inline int HorizontalSum(__m256i eight) {
  __m128i sum = _mm_add_epi32(_mm256_castsi256_si128(eight), _mm256_extracti128_si256(eight, 1));
  sum = _mm_add_epi32(sum, _mm_shuffle_epi32(sum, 0x4e));
  sum = _mm_add_epi32(sum, _mm_shuffle_epi32(sum, 0xb1));
  return _mm_cvtsi128_si32(sum);
}

__attribute__((target("avx2"))) void DotsAvx2(const std::int16_t* a, const std::int16_t* others,
                                              std::size_t count, int* dots) {
  constexpr std::size_t kWords = kSize / 16;
  __m256i query[kWords];
  for (std::size_t i = 0; i < kWords; ++i) {
    query[i] = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(a) + i);
  }
  for (std::size_t j = 0; j < count; ++j) {
    const auto* other = reinterpret_cast<const __m256i*>(others + j * kSize);
    __m256i even = _mm256_madd_epi16(query[0], _mm256_loadu_si256(other));
    __m256i odd = _mm256_madd_epi16(query[1], _mm256_loadu_si256(other + 1));
    for (std::size_t i = 2; i < kWords; i += 2) {
      even = _mm256_add_epi32(even, _mm256_madd_epi16(query[i], _mm256_loadu_si256(other + i)));
      odd =
          _mm256_add_epi32(odd, _mm256_madd_epi16(query[i + 1], _mm256_loadu_si256(other + i + 1)));
    }
    dots[j] = HorizontalSum(_mm256_add_epi32(even, odd));
  }
}

__attribute__((target("avx2"))) int DistanceSqAvx2(const std::uint8_t* a, const std::uint8_t* b) {
  const __m256i zero = _mm256_setzero_si256();
  __m256i low = zero, high = zero;
  for (std::size_t i = 0; i < kSize; i += 32) {
    const __m256i x = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(a + i));
    const __m256i y = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(b + i));
    // Saturated differences: one of the two is the absolute one, the other 0.
    const __m256i d = _mm256_or_si256(_mm256_subs_epu8(x, y), _mm256_subs_epu8(y, x));
    const __m256i d0 = _mm256_unpacklo_epi8(d, zero), d1 = _mm256_unpackhi_epi8(d, zero);
    low = _mm256_add_epi32(low, _mm256_madd_epi16(d0, d0));
    high = _mm256_add_epi32(high, _mm256_madd_epi16(d1, d1));
  }
  return HorizontalSum(_mm256_add_epi32(low, high));
}
#endif

int DistanceSqPortable(const std::uint8_t* a, const std::uint8_t* b) {
  int sum = 0;
  for (std::size_t i = 0; i < kSize; ++i) {
    const int d = int{a[i]} - int{b[i]};
    sum += d * d;
  }
  return sum;
}

using DotsFunction = void (*)(const std::int16_t*, const std::int16_t*, std::size_t, int*);

DotsFunction SelectDots() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return DotsAvx2;
#endif
  return DotsPortable;
}

using DistanceFunction = int (*)(const std::uint8_t*, const std::uint8_t*);

DistanceFunction SelectDistance() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return DistanceSqAvx2;
#endif
  return DistanceSqPortable;
}

}  // namespace

void MatchOptions::Check() const {
  if (!(max_ratio > 0 && max_ratio <= 1)) {
    throw std::invalid_argument(Format("max_ratio = %g; must lie in (0, 1]", max_ratio));
  }
}

int DescriptorDistanceSq(const std::uint8_t* a, const std::uint8_t* b) {
  static const DistanceFunction distance_of = SelectDistance();
  return distance_of(a, b);
}

std::vector<FeatureMatch> MatchDescriptors(std::span<const std::uint8_t> query,
                                           std::span<const std::uint8_t> database,
                                           const MatchOptions& options) {
  static const DotsFunction dots_of = SelectDots();
  const std::size_t num_query = query.size() / kSize, num_database = database.size() / kSize;
  if (num_query == 0 || num_database == 0) return {};
  const Wide query_wide = Widen(query), database_wide = Widen(database);
  std::vector<int> norms(num_database), dots(num_database);
  for (std::size_t j = 0; j < num_database; ++j) norms[j] = SquaredNorm(&database_wide[j * kSize]);

  constexpr int kFar = std::numeric_limits<int>::max();
  std::vector<int> column_best(num_database, kFar), column_query(num_database, -1);
  std::vector<FeatureMatch> nearest;
  for (std::size_t i = 0; i < num_query; ++i) {
    dots_of(&query_wide[i * kSize], database_wide.data(), num_database, dots.data());
    const int norm = SquaredNorm(&query_wide[i * kSize]);
    int best = kFar, second = kFar, best_j = -1;
    for (std::size_t j = 0; j < num_database; ++j) {
      const int distance = norm + norms[j] - 2 * dots[j];
      if (distance < best) {
        second = best, best = distance, best_j = static_cast<int>(j);
      } else if (distance < second) {
        second = distance;
      }
      if (distance < column_best[j])
        column_best[j] = distance, column_query[j] = static_cast<int>(i);
    }
    // Distances are squared, so is the ratio. A lone candidate cannot pass a ratio test.
    const double limit = options.max_ratio * options.max_ratio * second;
    if (options.max_ratio < 1 && !(second != kFar && best < limit)) continue;
    nearest.push_back({static_cast<int>(i), best_j, best});
  }
  if (options.mutual) {
    std::erase_if(nearest, [&](const FeatureMatch& m) {
      return column_query[static_cast<std::size_t>(m.database_idx)] != m.query_idx;
    });
  }
  return nearest;
}

}  // namespace panofix
