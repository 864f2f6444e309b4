// Turns columns of packets into rows, a cache line's worth of columns at a time, for views whose innermost axis is
// not the one that is contiguous in memory.
#include "path_functions.h"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace volsplat::VOLSPLAT_PATH {

void transpose(const std::uint32_t* source, std::ptrdiff_t stride, std::size_t n, std::uint32_t* lanes,
               std::size_t pitch) {
  // So far ahead that the line has arrived from memory when it is needed.
  constexpr std::ptrdiff_t kLinesAhead = 16;
  std::size_t at = 0;
#if defined(__SSE2__)
  for (; at + 4 <= n; at += 4) {
    const std::uint32_t* line = source + static_cast<std::ptrdiff_t>(at) * stride;
    for (int row = 0; row < 4; ++row) __builtin_prefetch(line + (kLinesAhead + row) * stride);

    // Exchange rows and columns of 4 x 4 packets
    for (int lane = 0; lane < kStripLanes; lane += 4) {
      const auto four = [&](int row) {
        return _mm_loadu_si128(reinterpret_cast<const __m128i*>(line + row * stride + lane));
      };
      const __m128i a = four(0), b = four(1), c = four(2), d = four(3);
      const __m128i ab_low = _mm_unpacklo_epi32(a, b), cd_low = _mm_unpacklo_epi32(c, d);
      const __m128i ab_high = _mm_unpackhi_epi32(a, b), cd_high = _mm_unpackhi_epi32(c, d);
      std::uint32_t* out = lanes + static_cast<std::size_t>(lane) * pitch + at;
      _mm_storeu_si128(reinterpret_cast<__m128i*>(out), _mm_unpacklo_epi64(ab_low, cd_low));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(out + pitch), _mm_unpackhi_epi64(ab_low, cd_low));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(out + 2 * pitch), _mm_unpacklo_epi64(ab_high, cd_high));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(out + 3 * pitch), _mm_unpackhi_epi64(ab_high, cd_high));
    }
  }
#endif
  for (; at < n; ++at) {
    const std::uint32_t* line = source + static_cast<std::ptrdiff_t>(at) * stride;
    for (int lane = 0; lane < kStripLanes; ++lane) lanes[static_cast<std::size_t>(lane) * pitch + at] = line[lane];
  }
}

}  // namespace volsplat::VOLSPLAT_PATH
