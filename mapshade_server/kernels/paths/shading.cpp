// Second pass over a row: colours the survivors by tables and writes shaded packets (paper: "Shading").
#include "path_functions.h"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace volsplat::VOLSPLAT_PATH {

namespace {

// The bits of a shaded packet; see protocol/packet_layout.py.
constexpr int kYShift = 14;
constexpr int kOpacityShift = 28;
constexpr int kColourShift = 40;

// From 2^-32 to 1/64 pixel, to the nearest.
inline std::int32_t lattice(std::int64_t fixed) {
  return static_cast<std::int32_t>((fixed + (std::int64_t{1} << 25)) >> 26);
}

#if defined(__SSE2__)

// r | g << 8 | b << 16 of emit + refl * light, clamped to 0..1 and rounded.
inline std::uint32_t colour_bytes(const float* emit, const float* refl, float light) {
  const __m128 sum = _mm_add_ps(_mm_loadu_ps(emit), _mm_mul_ps(_mm_loadu_ps(refl), _mm_set1_ps(light)));
  const __m128 clamped = _mm_min_ps(_mm_max_ps(sum, _mm_setzero_ps()), _mm_set1_ps(1.0f));
  const __m128 levels = _mm_add_ps(_mm_mul_ps(clamped, _mm_set1_ps(255.0f)), _mm_set1_ps(0.5f));
  const __m128i whole = _mm_cvttps_epi32(levels);
  const __m128i words = _mm_packs_epi32(whole, whole);
  return static_cast<std::uint32_t>(_mm_cvtsi128_si32(_mm_packus_epi16(words, words)));
}

#else

inline std::uint32_t colour_byte(float emit, float refl, float light) {
  const float sum = emit + refl * light;
  const float clamped = sum > 1.0f ? 1.0f : sum > 0.0f ? sum : 0.0f;
  return static_cast<std::uint32_t>(clamped * 255.0f + 0.5f);
}

inline std::uint32_t colour_bytes(const float* emit, const float* refl, float light) {
  return colour_byte(emit[0], refl[0], light) | colour_byte(emit[1], refl[1], light) << 8 |
         colour_byte(emit[2], refl[2], light) << 16;
}

#endif

}  // namespace

void shade(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, std::int32_t origin_x,
           std::int32_t origin_y, std::size_t first, std::size_t count, bool descending, std::uint64_t* out) {
  const std::ptrdiff_t next = descending ? -1 : 1;
  std::ptrdiff_t s = static_cast<std::ptrdiff_t>(first);
  for (std::size_t n = 0; n < count; ++n, s += next) {
    const std::int64_t position = samples.positions[s];
    const std::uint32_t direction = samples.packets[s] >> 16 & 0x7FFF;
    const std::uint32_t colour = colour_bytes(tables.emit + 4 * samples.emit_index[s],
                                              tables.refl + 4 * samples.refl_index[s], tables.light[direction]);
    // Modulo 2^32 the difference is exact, and it lies in 0..2^14-1
    const std::uint32_t x = static_cast<std::uint32_t>(lattice(line.start_x + position * line.step_x)) -
                            static_cast<std::uint32_t>(origin_x);
    const std::uint32_t y = static_cast<std::uint32_t>(lattice(line.start_y + position * line.step_y)) -
                            static_cast<std::uint32_t>(origin_y);
    out[n] = x | static_cast<std::uint64_t>(y) << kYShift |
             static_cast<std::uint64_t>(samples.opacity[s]) << kOpacityShift |
             static_cast<std::uint64_t>(colour) << kColourShift;
  }
}

}  // namespace volsplat::VOLSPLAT_PATH
