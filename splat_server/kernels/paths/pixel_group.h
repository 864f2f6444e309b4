// Combining in groups of 8 pixels (paper: "Combining"): the only arithmetic that an image's bits depend on.
// Every pixel sees the same operations in the same order whatever its neighbours, the stripe and the other pixels
// of the vector are. A path with fused multiply-add rounds less often than the baseline.
#pragma once
#ifdef __AVX2__
#include <immintrin.h>
#endif

#include "../splat_job.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

#ifdef __AVX2__
constexpr int kLanes = 8;
#define VOLSPLAT_LANE_BITS {1, 2, 4, 8, 16, 32, 64, 128}
#else
constexpr int kLanes = 4;
#define VOLSPLAT_LANE_BITS {1, 2, 4, 8}
#endif
constexpr int kParts = kGroupPixels / kLanes;
typedef float Lanes __attribute__((vector_size(kLanes * 4)));
typedef int32_t LaneBits __attribute__((vector_size(kLanes * 4)));

inline Lanes load(const float* address) {
    Lanes lanes;
    __builtin_memcpy(&lanes, address, sizeof lanes);
    return lanes;
}

inline void store(float* address, Lanes lanes) { __builtin_memcpy(address, &lanes, sizeof lanes); }

inline Lanes all_lanes(float value) {
#ifdef __AVX2__
    return _mm256_set1_ps(value);
#else
    return Lanes{value, value, value, value};
#endif
}

// Which of a group's pixels a row of weights reaches.
#ifdef __AVX512VL__
typedef __mmask8 PixelMask;

inline PixelMask pixel_mask(uint64_t bits) { return static_cast<PixelMask>(bits); }
inline Lanes load_within(const float* weights, PixelMask mask, int) { return _mm256_maskz_loadu_ps(mask, weights); }
#else
struct PixelMask {
    LaneBits parts[kParts];
};

inline PixelMask pixel_mask(uint64_t bits) {
    const LaneBits lane = VOLSPLAT_LANE_BITS;
    PixelMask mask;
    for (int part = 0; part < kParts; ++part) {
        const LaneBits spread = LaneBits{} + static_cast<int32_t>(bits >> (part * kLanes) & 255);
        mask.parts[part] = (spread & lane) == lane;
    }
    return mask;
}

inline Lanes load_within(const float* weights, const PixelMask& mask, int part) {
    return (Lanes)((LaneBits)load(weights) & mask.parts[part]);
}
#endif

// a * b + c, a - a * b
inline Lanes multiply_add(Lanes a, Lanes b, Lanes c) {
#ifdef __FMA__
    return _mm256_fmadd_ps(a, b, c);
#else
    return a * b + c;
#endif
}

// What of the opacity passes the alpha in front of it; 0 where that is frozen.
inline Lanes behind(Lanes opacity, Lanes alpha) {
#if defined(__AVX512VL__)
    const __mmask8 open = _mm256_cmp_ps_mask(alpha, all_lanes(kFrozenAlpha), _CMP_LT_OQ);
    return _mm256_maskz_fnmadd_ps(open, opacity, alpha, opacity);
#elif defined(__FMA__)
    const Lanes open = (Lanes)(alpha < kFrozenAlpha);
    return _mm256_and_ps(open, _mm256_fnmadd_ps(opacity, alpha, opacity));
#else
    return (Lanes)((LaneBits)(opacity - opacity * alpha) & (alpha < kFrozenAlpha));
#endif
}

inline Lanes at_most_1(Lanes a) {
#ifdef __AVX2__
    return _mm256_min_ps(a, all_lanes(1.0f));
#else
    const LaneBits below = a < 1.0f;
    return (Lanes)(((LaneBits)a & below) | ((LaneBits)all_lanes(1.0f) & ~below));
#endif
}

struct Point {  // a sample's opacity A and intensity I
    Lanes opacity, red, green, blue;
};

// Combines a point of opacity min(1, w A) with kLanes pixels. Front to back, `added` gathers the bits of what was
// added to alpha: it stays zero while every pixel that the weights reach is frozen.
template <bool kFrontToBack, bool kClamped>
inline void combine(float* pixels, Lanes weights, const Point& point, LaneBits& added) {
    Lanes opacity = weights * point.opacity;
    if constexpr (kClamped) opacity = at_most_1(opacity);
    const Lanes red = load(pixels), green = load(pixels + kGroupPixels), blue = load(pixels + 2 * kGroupPixels);
    const Lanes alpha = load(pixels + kAlphaPlane);
    if constexpr (kFrontToBack) {
        const Lanes visible = behind(opacity, alpha);
        added |= (LaneBits)visible;
        store(pixels, multiply_add(visible, point.red, red));
        store(pixels + kGroupPixels, multiply_add(visible, point.green, green));
        store(pixels + 2 * kGroupPixels, multiply_add(visible, point.blue, blue));
        store(pixels + kAlphaPlane, alpha + visible);
    } else {
        store(pixels, multiply_add(opacity, point.red - red, red));
        store(pixels + kGroupPixels, multiply_add(opacity, point.green - green, green));
        store(pixels + 2 * kGroupPixels, multiply_add(opacity, point.blue - blue, blue));
        store(pixels + kAlphaPlane, multiply_add(opacity, 1.0f - alpha, alpha));
    }
}

inline bool any(LaneBits bits) {
#ifdef __AVX2__
    return !_mm256_testz_si256((__m256i)bits, (__m256i)bits);
#else
    typedef int64_t Halves __attribute__((vector_size(16)));
    const Halves halves = (Halves)bits;
    return (halves[0] | halves[1]) != 0;
#endif
}

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
