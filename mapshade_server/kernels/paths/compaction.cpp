// First pass over a row of voxel packets: keeps those that can be seen. Most voxels of a volume end here.
#include "path_functions.h"

#if defined(__AVX2__)
// GCC warns of intrinsics' deliberately undefined lanes.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#pragma GCC diagnostic pop
#endif

namespace volsplat::VOLSPLAT_PATH {

#if defined(__AVX512F__)

std::size_t compact(const std::uint32_t* row, std::size_t n, const std::uint32_t* visible, std::uint32_t* positions,
                    std::uint32_t* packets) {
  std::size_t kept = 0;
  const __m512i lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  const __m512i low_16_bits = _mm512_set1_epi32(0xFFFF);
  const __m512i bit = _mm512_set1_epi32(1);
  for (std::size_t at = 0; at < n; at += 16) {
    // Look up one bit for each of 16 packets
    const __mmask16 inside = n - at >= 16 ? 0xFFFF : static_cast<__mmask16>((1u << (n - at)) - 1);
    const __m512i packet = _mm512_maskz_loadu_epi32(inside, row + at);
    const __m512i index = _mm512_and_si512(packet, low_16_bits);
    const __m512i words = _mm512_i32gather_epi32(_mm512_srli_epi32(index, 5), visible, 4);
    const __m512i shift = _mm512_and_si512(index, _mm512_set1_epi32(31));
    const __mmask16 seen = _mm512_test_epi32_mask(_mm512_srlv_epi32(words, shift), bit);
    const __mmask16 has_data = static_cast<__mmask16>(~_mm512_movepi32_mask(packet));
    const __mmask16 keep = seen & has_data & inside;

    // Move the kept ones together
    const __m512i position = _mm512_add_epi32(lanes, _mm512_set1_epi32(static_cast<int>(at)));
    _mm512_storeu_si512(positions + kept, _mm512_maskz_compress_epi32(keep, position));
    _mm512_storeu_si512(packets + kept, _mm512_maskz_compress_epi32(keep, packet));
    kept += static_cast<unsigned>(__builtin_popcount(keep));
  }
  return kept;
}

#else

namespace {

#if defined(__AVX2__)

// For each mask of 8 lanes: the lane numbers whose bits are set, moved to the front.
struct LaneOrders {
  std::uint32_t of_mask[256][8];
  constexpr LaneOrders() : of_mask{} {
    for (int mask = 0; mask < 256; ++mask) {
      int filled = 0;
      for (int lane = 0; lane < 8; ++lane) {
        if (mask >> lane & 1) of_mask[mask][filled++] = static_cast<std::uint32_t>(lane);
      }
    }
  }
};
constexpr LaneOrders kLaneOrders;

// Compacts whole groups of 8 packets, leaves the rest; returns how many were kept.
std::size_t compact_groups(const std::uint32_t* row, std::size_t n, const std::uint32_t* visible,
                           std::uint32_t* positions, std::uint32_t* packets) {
  std::size_t kept = 0;
  const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  for (std::size_t at = 0; at + 8 <= n; at += 8) {
    // Look up one bit for each of 8 packets, moved to the sign
    const __m256i packet = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(row + at));
    const __m256i index = _mm256_and_si256(packet, _mm256_set1_epi32(0xFFFF));
    const __m256i words =
        _mm256_i32gather_epi32(reinterpret_cast<const int*>(visible), _mm256_srli_epi32(index, 5), 4);
    const __m256i to_sign = _mm256_andnot_si256(index, _mm256_set1_epi32(31));
    const __m256i seen = _mm256_andnot_si256(packet, _mm256_sllv_epi32(words, to_sign));
    const unsigned keep = static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(seen)));

    // Move the kept ones together
    const __m256i order = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(kLaneOrders.of_mask[keep]));
    const __m256i position = _mm256_add_epi32(lanes, _mm256_set1_epi32(static_cast<int>(at)));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(positions + kept), _mm256_permutevar8x32_epi32(position, order));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(packets + kept), _mm256_permutevar8x32_epi32(packet, order));
    kept += static_cast<unsigned>(__builtin_popcount(keep));
  }
  return kept;
}

#else

std::size_t compact_groups(const std::uint32_t* row, std::size_t n, const std::uint32_t* visible,
                           std::uint32_t* positions, std::uint32_t* packets) {
  std::size_t kept = 0;
  for (std::size_t at = 0; at < (n & ~std::size_t{7}); ++at) {
    const std::uint32_t packet = row[at];
    positions[kept] = static_cast<std::uint32_t>(at);
    packets[kept] = packet;
    kept += visible[(packet & 0xFFFF) >> 5] >> (packet & 31) & ~(packet >> 31) & 1;
  }
  return kept;
}

#endif

}  // namespace

std::size_t compact(const std::uint32_t* row, std::size_t n, const std::uint32_t* visible, std::uint32_t* positions,
                    std::uint32_t* packets) {
  std::size_t kept = compact_groups(row, n, visible, positions, packets);
  for (std::size_t at = n & ~std::size_t{7}; at < n; ++at) {
    const std::uint32_t packet = row[at];
    positions[kept] = static_cast<std::uint32_t>(at);
    packets[kept] = packet;
    kept += visible[(packet & 0xFFFF) >> 5] >> (packet & 31) & ~(packet >> 31) & 1;
  }
  return kept;
}

#endif

}  // namespace volsplat::VOLSPLAT_PATH
