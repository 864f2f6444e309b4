// Colours the survivors of a row by tables and writes shaded packets (paper: "Shading").
//
// A colour is emit + refl * light, clamped to 0..1 and rounded to bytes, in float32. Positions are exact in float64:
// counted from the run's origin they have 14 bits before the point and 26 behind it.
#include "intrinsics.h"
#include "kernels/packet_layout.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr double kLatticeUnit = 1.0 / 67108864.0;  // 1/64 pixel is 2^26 of the fixed-point unit
constexpr std::int64_t kHalfUnit = std::int64_t{1} << 25;

// Offsets from a run's origin along one axis, 1/64 pixel: n samples after the run's lowest one they are the whole
// part of start + n * step.
struct Offsets {
  double start, step;

  Offsets(std::int64_t row_start, std::int64_t row_step, std::int64_t lowest, std::int32_t origin)
      : start(static_cast<double>(row_start + lowest * row_step + kHalfUnit - (std::int64_t{origin} << 26)) *
              kLatticeUnit),
        step(static_cast<double>(row_step) * kLatticeUnit) {}

  std::uint32_t at(std::int32_t n) const {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(start + n * step));
  }
};

// What the samples of a run are shaded by.
class RunShading {
 public:
  RunShading(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, const RunSamples& run)
      : samples_(samples),
        tables_(tables),
        lowest_(samples.voxels.positions[run.first]),
        x_(line.start_x, line.step_x, lowest_, run.origin_x),
        y_(line.start_y, line.step_y, lowest_, run.origin_y) {}

 protected:
  const float* emit(std::size_t s) const { return tables_.emit + 4 * samples_.emit.bytes[s * samples_.emit.spacing]; }
  const float* refl(std::size_t s) const { return tables_.refl + 4 * samples_.refl.bytes[s * samples_.refl.spacing]; }

  const SurvivingSamples& samples_;
  const ColourTables& tables_;
  const std::int32_t lowest_;
  const Offsets x_, y_;
};

#if defined(__AVX512F__)

constexpr std::size_t kTogether = 16;

// Sixteen samples at a time. Colours are worked on in four registers: number q holds samples q, 4 + q, 8 + q and
// 12 + q, so that packing to bytes leaves them in order.
class GroupShading : public RunShading {
 public:
  using RunShading::RunShading;

  // Writes samples s..s+15 to out..out+15, or the other way round.
  void write(std::size_t s, bool descending, std::uint64_t* out) const {
    const __m512i colours = colours_of(s);
    const __m512i codes = widened(samples_.opacity + s);
    const __m512i n = _mm512_sub_epi32(widened(samples_.voxels.positions + s), _mm512_set1_epi32(lowest_));
    const __m512i place = _mm512_or_si512(offsets(x_, n), _mm512_slli_epi32(offsets(y_, n), kPositionBits));
    const __m512i low = _mm512_or_si512(place, _mm512_slli_epi32(codes, kOpacityShift));
    const __m512i high = _mm512_or_si512(_mm512_srli_epi32(codes, 32 - kOpacityShift),
                                         _mm512_slli_epi32(colours, kColourShift - 32));
    // Put lower and upper halves side by side
    const std::int32_t(*order)[16] = kOrders[descending];
    for (int half = 0; half < 2; ++half) {
      _mm512_storeu_si512(out + 8 * half, _mm512_permutex2var_epi32(low, _mm512_loadu_si512(order[half]), high));
    }
  }

 private:
  // For ascending and descending runs, for each half of the output: lanes of `low`, and of `high` from 16 on.
  static constexpr std::int32_t kOrders[2][2][16] = {
      {{0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23},
       {8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31}},
      {{15, 31, 14, 30, 13, 29, 12, 28, 11, 27, 10, 26, 9, 25, 8, 24},
       {7, 23, 6, 22, 5, 21, 4, 20, 3, 19, 2, 18, 1, 17, 0, 16}}};

  static __m512i widened(const std::uint16_t* numbers) {
    return _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(numbers)));
  }

  static __m256i offsets(const Offsets& axis, __m256i n) {
    const __m512d way = _mm512_mul_pd(_mm512_cvtepi32_pd(n), _mm512_set1_pd(axis.step));
    return _mm512_cvttpd_epi32(_mm512_add_pd(_mm512_set1_pd(axis.start), way));
  }

  static __m512i offsets(const Offsets& axis, __m512i n) {
    return _mm512_inserti64x4(_mm512_castsi256_si512(offsets(axis, _mm512_castsi512_si256(n))),
                              offsets(axis, _mm512_extracti64x4_epi64(n, 1)), 1);
  }

  static __m512 four(const float* a, const float* b, const float* c, const float* d) {
    const __m512 ab = _mm512_insertf32x4(_mm512_castps128_ps512(_mm_loadu_ps(a)), _mm_loadu_ps(b), 1);
    return _mm512_insertf32x4(_mm512_insertf32x4(ab, _mm_loadu_ps(c), 2), _mm_loadu_ps(d), 3);
  }

  template <int q>
  __m512i levels(std::size_t s, __m512 light) const {
    const __m512 emitted = four(emit(s + q), emit(s + 4 + q), emit(s + 8 + q), emit(s + 12 + q));
    const __m512 reflected = four(refl(s + q), refl(s + 4 + q), refl(s + 8 + q), refl(s + 12 + q));
    const __m512 sum = _mm512_add_ps(emitted, _mm512_mul_ps(reflected, _mm512_permute_ps(light, q * 0x55)));
    const __m512 clamped = _mm512_min_ps(_mm512_max_ps(sum, _mm512_setzero_ps()), _mm512_set1_ps(1.0f));
    return _mm512_cvttps_epi32(
        _mm512_add_ps(_mm512_mul_ps(clamped, _mm512_set1_ps(255.0f)), _mm512_set1_ps(0.5f)));
  }

  __m512i colours_of(std::size_t s) const {
    const __m512i packet = _mm512_loadu_si512(samples_.voxels.packets + s);
    const __m512i direction = _mm512_and_si512(_mm512_srli_epi32(packet, kDirectionShift), _mm512_set1_epi32(kDirectionMask));
    const __m512 light = _mm512_i32gather_ps(direction, tables_.light, 4);
    return _mm512_packus_epi16(_mm512_packs_epi32(levels<0>(s, light), levels<1>(s, light)),
                               _mm512_packs_epi32(levels<2>(s, light), levels<3>(s, light)));
  }
};

#elif defined(__AVX2__)

constexpr std::size_t kTogether = 8;

// Eight samples at a time. Colours are worked on in four registers: number q holds samples q and 4 + q, so that
// packing to bytes leaves them in order.
class GroupShading : public RunShading {
 public:
  using RunShading::RunShading;

  // Writes samples s..s+7 to out..out+7, or the other way round.
  void write(std::size_t s, bool descending, std::uint64_t* out) const {
    const __m256i colours = colours_of(s);
    const __m256i codes = widened(samples_.opacity + s);
    const __m256i n = _mm256_sub_epi32(widened(samples_.voxels.positions + s), _mm256_set1_epi32(lowest_));
    const __m256i place = _mm256_or_si256(offsets(x_, n), _mm256_slli_epi32(offsets(y_, n), kPositionBits));
    __m256i low = _mm256_or_si256(place, _mm256_slli_epi32(codes, kOpacityShift));
    __m256i high = _mm256_or_si256(_mm256_srli_epi32(codes, 32 - kOpacityShift),
                                   _mm256_slli_epi32(colours, kColourShift - 32));
    if (descending) {
      const __m256i reversed = _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0);
      low = _mm256_permutevar8x32_epi32(low, reversed);
      high = _mm256_permutevar8x32_epi32(high, reversed);
    }
    // Put lower and upper halves side by side
    const __m256i inner = _mm256_unpacklo_epi32(low, high), outer = _mm256_unpackhi_epi32(low, high);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), _mm256_permute2x128_si256(inner, outer, 0x20));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + 4), _mm256_permute2x128_si256(inner, outer, 0x31));
  }

 private:
  static __m256i widened(const std::uint16_t* numbers) {
    return _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(numbers)));
  }

  static __m128i offsets(const Offsets& axis, __m128i n) {
    const __m256d way = _mm256_mul_pd(_mm256_cvtepi32_pd(n), _mm256_set1_pd(axis.step));
    return _mm256_cvttpd_epi32(_mm256_add_pd(_mm256_set1_pd(axis.start), way));
  }

  static __m256i offsets(const Offsets& axis, __m256i n) {
    return _mm256_inserti128_si256(_mm256_castsi128_si256(offsets(axis, _mm256_castsi256_si128(n))),
                                   offsets(axis, _mm256_extracti128_si256(n, 1)), 1);
  }

  static __m256 two(const float* a, const float* b) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(a)), _mm_loadu_ps(b), 1);
  }

  template <int q>
  __m256i levels(std::size_t s, __m256 light) const {
    const __m256 emitted = two(emit(s + q), emit(s + 4 + q)), reflected = two(refl(s + q), refl(s + 4 + q));
    const __m256 sum = _mm256_add_ps(emitted, _mm256_mul_ps(reflected, _mm256_permute_ps(light, q * 0x55)));
    const __m256 clamped = _mm256_min_ps(_mm256_max_ps(sum, _mm256_setzero_ps()), _mm256_set1_ps(1.0f));
    return _mm256_cvttps_epi32(
        _mm256_add_ps(_mm256_mul_ps(clamped, _mm256_set1_ps(255.0f)), _mm256_set1_ps(0.5f)));
  }

  __m256i colours_of(std::size_t s) const {
    const __m256i packet = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(samples_.voxels.packets + s));
    const __m256i direction = _mm256_and_si256(_mm256_srli_epi32(packet, kDirectionShift), _mm256_set1_epi32(kDirectionMask));
    const __m256 light = _mm256_i32gather_ps(tables_.light, direction, 4);
    return _mm256_packus_epi16(_mm256_packs_epi32(levels<0>(s, light), levels<1>(s, light)),
                               _mm256_packs_epi32(levels<2>(s, light), levels<3>(s, light)));
  }
};

#else

constexpr std::size_t kTogether = 1;

class GroupShading : public RunShading {
 public:
  using RunShading::RunShading;

  void write(std::size_t s, bool, std::uint64_t* out) const {
    const std::int32_t n = samples_.voxels.positions[s] - lowest_;
    *out = x_.at(n) | static_cast<std::uint64_t>(y_.at(n)) << kPositionBits |
           static_cast<std::uint64_t>(samples_.opacity[s]) << kOpacityShift |
           static_cast<std::uint64_t>(colour_bytes(s)) << kColourShift;
  }

 private:
  float light(std::size_t s) const { return tables_.light[samples_.voxels.packets[s] >> kDirectionShift & kDirectionMask]; }

#if defined(__SSE2__)

  // r | g << 8 | b << 16
  std::uint32_t colour_bytes(std::size_t s) const {
    const __m128 reflected = _mm_mul_ps(_mm_loadu_ps(refl(s)), _mm_set1_ps(light(s)));
    const __m128 sum = _mm_add_ps(_mm_loadu_ps(emit(s)), reflected);
    const __m128 clamped = _mm_min_ps(_mm_max_ps(sum, _mm_setzero_ps()), _mm_set1_ps(1.0f));
    const __m128 levels = _mm_add_ps(_mm_mul_ps(clamped, _mm_set1_ps(255.0f)), _mm_set1_ps(0.5f));
    const __m128i whole = _mm_cvttps_epi32(levels);
    const __m128i words = _mm_packs_epi32(whole, whole);
    return static_cast<std::uint32_t>(_mm_cvtsi128_si32(_mm_packus_epi16(words, words)));
  }

#else

  std::uint32_t colour_bytes(std::size_t s) const {
    return colour_byte(s, 0) | colour_byte(s, 1) << 8 | colour_byte(s, 2) << 16;
  }

  std::uint32_t colour_byte(std::size_t s, int channel) const {
    const float sum = emit(s)[channel] + refl(s)[channel] * light(s);
    const float clamped = sum > 1.0f ? 1.0f : sum > 0.0f ? sum : 0.0f;
    return static_cast<std::uint32_t>(clamped * 255.0f + 0.5f);
  }

#endif
};

#endif

}  // namespace

void shade(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, const RunSamples& run,
           std::uint64_t* out) {
  const GroupShading shading(samples, tables, line, run);
  if (run.count < kTogether) {
    // Shade what lies behind the run too, but do not hand it out
    std::uint64_t all[kTogether];
    shading.write(run.first, run.descending, all);
    const std::uint64_t* ours = run.descending ? all + (kTogether - run.count) : all;
    for (std::size_t n = 0; n < run.count; ++n) out[n] = ours[n];
    return;
  }
  for (std::size_t done = 0; done < run.count; done += kTogether) {
    // The last group overlaps the one before
    const std::size_t at = done + kTogether <= run.count ? done : run.count - kTogether;
    shading.write(run.first + at, run.descending, out + (run.descending ? run.count - kTogether - at : at));
  }
}

}  // namespace volsplat::VOLSPLAT_PATH
