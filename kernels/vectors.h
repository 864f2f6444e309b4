// Neighbouring numbers at once: vectors of float32 and of 32 bits as wide as the instruction set has them, with what
// their operators do not say. Instructions are written by name only here and in what builds on it; every set
// gives the same bits.
#pragma once

#if defined(__AVX2__)
#if !defined(__clang__)
// GCC warns of intrinsics' deliberately undefined lanes.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <immintrin.h>
#if !defined(__clang__)
#pragma GCC diagnostic pop
#endif
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

#include <cstdint>

namespace volsplat::VOLSPLAT_PATH {

namespace {

typedef float Four __attribute__((vector_size(16)));
typedef std::int32_t FourBits __attribute__((vector_size(16)));
#if defined(__AVX2__)
typedef float Eight __attribute__((vector_size(32)));
typedef std::int32_t EightBits __attribute__((vector_size(32)));
#endif
#if defined(__AVX512F__)
typedef float Sixteen __attribute__((vector_size(64)));
typedef std::int32_t SixteenBits __attribute__((vector_size(64)));
typedef Sixteen Widest;
#elif defined(__AVX2__)
typedef Eight Widest;
#else
typedef Four Widest;
#endif
constexpr int kWidest = sizeof(Widest) / sizeof(float);
typedef std::int32_t WidestBits __attribute__((vector_size(4 * kWidest)));
typedef std::uint32_t WidestWords __attribute__((vector_size(4 * kWidest)));

template <class Lanes, class Number>
inline Lanes load(const Number* address) {
    Lanes lanes;
    __builtin_memcpy(&lanes, address, sizeof lanes);
    return lanes;
}

template <class Number, class Lanes>
inline void store(Number* address, const Lanes& lanes) {
    __builtin_memcpy(address, &lanes, sizeof lanes);
}

// All lanes alike; the first ones of more.
inline void fill(float value, Four& lanes) { lanes = Four{value, value, value, value}; }
inline Four first_of(Four lanes, Four) { return lanes; }
#if defined(__AVX2__)
inline void fill(float value, Eight& lanes) { lanes = _mm256_set1_ps(value); }
inline Eight first_of(Eight lanes, Eight) { return lanes; }
inline Four first_of(Eight lanes, Four) { return _mm256_castps256_ps128(lanes); }
#endif
#if defined(__AVX512F__)
inline void fill(float value, Sixteen& lanes) { lanes = _mm512_set1_ps(value); }
inline Sixteen first_of(Sixteen lanes, Sixteen) { return lanes; }
inline Four first_of(Sixteen lanes, Four) { return __builtin_shufflevector(lanes, lanes, 0, 1, 2, 3); }
#endif

template <class Lanes>
inline Lanes all_lanes(float value) {
    Lanes lanes;
    fill(value, lanes);
    return lanes;
}

// Numbers of 16 bits as twice as wide ones, those below 0 as what wraps to them.
typedef std::uint32_t EightWords32 __attribute__((vector_size(32)));
inline EightWords32 eight_widened(const std::int16_t* numbers) {
#if defined(__AVX2__)
    return (EightWords32)_mm256_cvtepi16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(numbers)));
#else
    typedef std::int16_t EightHalves __attribute__((vector_size(16)));
    return __builtin_convertvector(load<EightHalves>(numbers), EightWords32);
#endif
}

// Whether there is a bit.
inline bool any(FourBits bits) {
    typedef std::int64_t Halves __attribute__((vector_size(16)));
    const Halves halves = (Halves)bits;
    return (halves[0] | halves[1]) != 0;
}
#if defined(__AVX2__)
inline bool any(EightBits bits) { return !_mm256_testz_si256((__m256i)bits, (__m256i)bits); }
#endif
#if defined(__AVX512F__)
inline bool any(SixteenBits bits) { return _mm512_test_epi32_mask((__m512i)bits, (__m512i)bits) != 0; }
#endif

// a < 1 ? a : 1
inline Four at_most_1(Four a) {
#if defined(__SSE2__)
    return _mm_min_ps(a, _mm_set1_ps(1.0f));
#else
    const FourBits below = a < 1.0f;
    return (Four)(((FourBits)a & below) | ((FourBits)(Four{} + 1.0f) & ~below));
#endif
}
#if defined(__AVX2__)
inline Eight at_most_1(Eight a) { return _mm256_min_ps(a, _mm256_set1_ps(1.0f)); }

// The lanes of these numbers.
inline Eight picked(Eight lanes, EightBits numbers) { return _mm256_permutevar8x32_ps(lanes, (__m256i)numbers); }
#endif
#if defined(__AVX512F__)
// With a mask of all lanes, since GCC 12 warns of the plain one.
inline Sixteen at_most_1(Sixteen a) { return _mm512_maskz_min_ps(0xffff, a, _mm512_set1_ps(1.0f)); }
#endif

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
