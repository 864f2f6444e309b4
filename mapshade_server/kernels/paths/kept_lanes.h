// Some neighbouring voxels of a row at once, and the writing of those that are kept next to each other.
#pragma once
#include "intrinsics.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

#if defined(__AVX512F__)

constexpr int kLanes = 16;
typedef __m512i Positions;

inline Positions positions_from(std::size_t first) {
  const __m512i lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  return _mm512_add_epi32(lanes, _mm512_set1_epi32(static_cast<int>(first)));
}

inline Positions positions_at(const std::uint16_t* positions) {
  return _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(positions)));
}

// Writes the lanes whose bit is set, and anything behind them up to kLanes; returns how many are kept.
inline unsigned keep(Positions from, const std::uint32_t* packets_from, std::uint32_t bits, std::uint16_t* positions,
                     std::uint32_t* packets) {
  const __mmask16 kept = static_cast<__mmask16>(bits);
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(positions),
                      _mm512_cvtepi32_epi16(_mm512_maskz_compress_epi32(kept, from)));
  _mm512_storeu_si512(packets, _mm512_maskz_compress_epi32(kept, _mm512_loadu_si512(packets_from)));
  return static_cast<unsigned>(__builtin_popcount(bits));
}

#elif defined(__AVX2__)

constexpr int kLanes = 8;
typedef __m256i Positions;

inline Positions positions_from(std::size_t first) {
  return _mm256_add_epi32(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), _mm256_set1_epi32(static_cast<int>(first)));
}

inline Positions positions_at(const std::uint16_t* positions) {
  return _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(positions)));
}

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

inline unsigned keep(Positions from, const std::uint32_t* packets_from, std::uint32_t bits, std::uint16_t* positions,
                     std::uint32_t* packets) {
  const __m256i order = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(kLaneOrders.of_mask[bits]));
  const __m256i places = _mm256_permutevar8x32_epi32(from, order);
  const __m128i low = _mm256_castsi256_si128(places), high = _mm256_extracti128_si256(places, 1);
  _mm_storeu_si128(reinterpret_cast<__m128i*>(positions), _mm_packus_epi32(low, high));
  const __m256i packet = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(packets_from));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(packets), _mm256_permutevar8x32_epi32(packet, order));
  return static_cast<unsigned>(__builtin_popcount(bits));
}

#else

constexpr int kLanes = 4;

typedef std::int32_t Positions __attribute__((vector_size(4 * kLanes)));

inline Positions positions_from(std::size_t first) { return Positions{0, 1, 2, 3} + static_cast<std::int32_t>(first); }

inline Positions positions_at(const std::uint16_t* positions) {
  return Positions{positions[0], positions[1], positions[2], positions[3]};
}

inline unsigned keep(Positions from, const std::uint32_t* packets_from, std::uint32_t bits,
                     std::uint16_t* positions, std::uint32_t* packets) {
  unsigned kept = 0;
  for (int lane = 0; lane < kLanes; ++lane) {
    positions[kept] = static_cast<std::uint16_t>(from[lane]);
    packets[kept] = packets_from[lane];
    kept += bits >> lane & 1;
  }
  return kept;
}

#endif

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
