// Combining neighbouring pixels of a row at once (paper: "Combining"): the arithmetic that an image's bits depend on.
// Every pixel sees the same operations in the same order whatever its neighbours, the stripe and its place in the
// vector are. A path with fused multiply-add rounds less often than the baseline.
#pragma once
#ifdef __AVX2__
#include <immintrin.h>
#endif

#include "../splat_job.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

typedef float Four __attribute__((vector_size(16)));
typedef int32_t FourBits __attribute__((vector_size(16)));

// a * b + c
inline Four multiply_add(Four a, Four b, Four c) {
#ifdef __FMA__
    return _mm_fmadd_ps(a, b, c);
#else
    return a * b + c;
#endif
}

// What of the opacity passes the alpha in front of it; 0 where that is frozen.
inline Four behind(Four opacity, Four alpha) {
#if defined(__AVX512VL__)
    const __mmask8 open = _mm_cmp_ps_mask(alpha, _mm_set1_ps(kFrozenAlpha), _CMP_LT_OQ);
    return _mm_maskz_fnmadd_ps(open, opacity, alpha, opacity);
#elif defined(__FMA__)
    return _mm_and_ps((Four)(alpha < kFrozenAlpha), _mm_fnmadd_ps(opacity, alpha, opacity));
#else
    return (Four)((FourBits)(opacity - opacity * alpha) & (alpha < kFrozenAlpha));
#endif
}

inline Four at_most_1(Four a) {
    const FourBits below = a < 1.0f;
    return (Four)(((FourBits)a & below) | ((FourBits)(Four{} + 1.0f) & ~below));
}

inline bool any(FourBits bits) {
    typedef int64_t Halves __attribute__((vector_size(16)));
    const Halves halves = (Halves)bits;
    return (halves[0] | halves[1]) != 0;
}

#ifdef __AVX2__
typedef float Widest __attribute__((vector_size(32)));
typedef int32_t WidestBits __attribute__((vector_size(32)));

inline Widest multiply_add(Widest a, Widest b, Widest c) { return _mm256_fmadd_ps(a, b, c); }

inline Widest behind(Widest opacity, Widest alpha) {
#ifdef __AVX512VL__
    const __mmask8 open = _mm256_cmp_ps_mask(alpha, _mm256_set1_ps(kFrozenAlpha), _CMP_LT_OQ);
    return _mm256_maskz_fnmadd_ps(open, opacity, alpha, opacity);
#else
    return _mm256_and_ps((Widest)(alpha < kFrozenAlpha), _mm256_fnmadd_ps(opacity, alpha, opacity));
#endif
}

inline Widest at_most_1(Widest a) { return _mm256_min_ps(a, _mm256_set1_ps(1.0f)); }

inline bool any(WidestBits bits) { return !_mm256_testz_si256((__m256i)bits, (__m256i)bits); }

inline Widest all_lanes(float value) { return _mm256_set1_ps(value); }
inline Four first_four(Widest lanes) { return _mm256_castps256_ps128(lanes); }
inline Widest first_of(Widest lanes, Widest) { return lanes; }
inline Four first_of(Widest lanes, Four) { return first_four(lanes); }
#else
typedef Four Widest;
typedef FourBits WidestBits;

inline Widest all_lanes(float value) { return Four{value, value, value, value}; }
inline Four first_of(Four lanes, Four) { return lanes; }
#endif
constexpr int kWidest = sizeof(Widest) / sizeof(float);

template <class Lanes>
inline Lanes load(const float* address) {
    Lanes lanes;
    __builtin_memcpy(&lanes, address, sizeof lanes);
    return lanes;
}

// As `load`, once for all uses: the compiler would rather load again for each.
template <class Lanes>
inline Lanes load_once(const float* address) {
    Lanes lanes = load<Lanes>(address);
#ifdef __x86_64__
    __asm__("" : "+x"(lanes));
#endif
    return lanes;
}

template <class Lanes>
inline void store(float* address, Lanes lanes) {
    __builtin_memcpy(address, &lanes, sizeof lanes);
}

// A sample's opacity A and intensity I, in all lanes.
struct Point {
    Widest opacity, red, green, blue;
};

// The bits of what was added to alpha, front to back: zero while every pixel that the weights reach is frozen.
struct Added {
    WidestBits widest;
    FourBits four;

    void note(Widest visible) { widest |= (WidestBits)visible; }
#ifdef __AVX2__
    void note(Four visible) { four |= (FourBits)visible; }
#endif
    bool any_at_all() const { return any(widest) || any(four); }
};

// Combines a point of opacity min(1, w A) with as many pixels as Lanes has, in the four planes of a row.
template <bool kFrontToBack, bool kClamped, class Lanes>
__attribute__((always_inline)) inline void combine(float* pixels, int64_t plane, const float* weights,
                                                   const Point& point, Added& added) {
    const auto part = [](Widest lanes) { return first_of(lanes, Lanes{}); };
    Lanes opacity = load<Lanes>(weights) * part(point.opacity);
    if constexpr (kClamped) opacity = at_most_1(opacity);
    float* const alphas = pixels + 3 * plane;
    if constexpr (kFrontToBack) {
        const Lanes alpha = load<Lanes>(alphas), visible = behind(opacity, alpha);
        added.note(visible);
        const auto add = [&](float* channel, Widest intensity) {
            store(channel, multiply_add(visible, part(intensity), load<Lanes>(channel)));
        };
        add(pixels, point.red), add(pixels + plane, point.green), add(pixels + 2 * plane, point.blue);
        store(alphas, alpha + visible);
    } else {
        const auto mix = [&](float* channel, Lanes intensity) {
            const Lanes before = load_once<Lanes>(channel);
            store(channel, multiply_add(opacity, intensity - before, before));
        };
        mix(pixels, part(point.red)), mix(pixels + plane, part(point.green));
        mix(pixels + 2 * plane, part(point.blue)), mix(alphas, part(all_lanes(1.0f)));
    }
}

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
