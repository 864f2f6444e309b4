// Looks up opacity codes, and the bytes of packet fields that do not lie in the packet itself.
#include "intrinsics.h"
#include "kernels/packet_layout.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

bool opacity_by_packet(const std::uint32_t* packets, std::size_t n, const std::uint16_t* table, std::uint16_t* codes) {
  std::size_t at = 0;
  bool none_zero = true;
#if defined(__AVX512F__)
  for (; at < n; at += 16) {
    const __mmask16 inside = n - at >= 16 ? 0xFFFF : static_cast<__mmask16>((1u << (n - at)) - 1);
    const __m512i low_16_bits = _mm512_set1_epi32(0xFFFF);
    const __m512i index = _mm512_and_si512(_mm512_maskz_loadu_epi32(inside, packets + at), low_16_bits);
    const __m512i pair = _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), inside, index, table, 2);
    none_zero &= _mm512_mask_testn_epi32_mask(inside, pair, low_16_bits) == 0;
    _mm256_mask_storeu_epi16(codes + at, inside, _mm512_cvtepi32_epi16(pair));
  }
#elif defined(__AVX2__)
  for (; at + 8 <= n; at += 8) {
    const __m256i low_16_bits = _mm256_set1_epi32(0xFFFF);
    const __m256i packet = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(packets + at));
    const __m256i pair = _mm256_i32gather_epi32(reinterpret_cast<const int*>(table),
                                                _mm256_and_si256(packet, low_16_bits), 2);
    const __m256i code = _mm256_and_si256(pair, low_16_bits);
    none_zero &= _mm256_movemask_epi8(_mm256_cmpeq_epi32(code, _mm256_setzero_si256())) == 0;
    _mm_storeu_si128(reinterpret_cast<__m128i*>(codes + at),
                     _mm_packus_epi32(_mm256_castsi256_si128(code), _mm256_extracti128_si256(code, 1)));
  }
#endif
  for (; at < n; ++at) {
    codes[at] = table[packets[at] & 0xFFFF];
    none_zero &= codes[at] != 0;
  }
  return none_zero;
}

bool opacity_by_indices(const TableIndices& opac, const TableIndices& modu, std::size_t n, const std::uint16_t* table,
                        std::uint16_t* codes) {
  bool none_zero = true;
  for (std::size_t at = 0; at < n; ++at) {
    codes[at] = table[opac.bytes[at * opac.spacing] | modu.bytes[at * modu.spacing] << 8];
    none_zero &= codes[at] != 0;
  }
  return none_zero;
}

void direction_bytes(const std::uint32_t* packets, std::size_t n, const std::uint8_t* table, std::uint8_t* bytes) {
  for (std::size_t at = 0; at < n; ++at) bytes[at] = table[packets[at] >> kDirectionShift & kDirectionMask];
}

void screen_bytes(const std::uint16_t* positions, std::size_t n, std::int64_t start, std::int64_t step,
                  std::uint8_t* bytes) {
  // In bytes and their fractions; exact, as all of start, step and their sums fit into a float64's mantissa
  constexpr double kUnit = 1.0 / 4294967296.0;
  const double from = static_cast<double>(start) * kUnit, by = static_cast<double>(step) * kUnit;
  for (std::size_t at = 0; at < n; ++at) {
    const double value = from + static_cast<double>(static_cast<std::int32_t>(positions[at])) * by;
    const double positive = value > 0.0 ? value : 0.0;
    bytes[at] = static_cast<std::uint8_t>(static_cast<std::int32_t>(positive < 255.0 ? positive : 255.0));
  }
}

void grid_bytes(const std::uint16_t* positions, std::size_t n, const std::uint8_t* table, std::int64_t step,
                std::uint8_t* bytes) {
  for (std::size_t at = 0; at < n; ++at) bytes[at] = table[positions[at] * step];
}

}  // namespace volsplat::VOLSPLAT_PATH
