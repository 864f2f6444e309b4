// Combining neighbouring pixels of a row at once (paper: "Combining"): the arithmetic that an image's bits depend on.
// Every pixel sees the same operations in the same order whatever its neighbours, the region and its place in the
// vector are. A path with fused multiply-add rounds less often than the baseline.
#pragma once

#include "kernels/vectors.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

// a * b + c
inline Four multiply_add(Four a, Four b, Four c) {
#ifdef __FMA__
    return _mm_fmadd_ps(a, b, c);
#else
    return a * b + c;
#endif
}

// What of the opacity passes the alpha in front of it; 0 where that is `frozen`.
inline Four behind(Four opacity, Four alpha, Four frozen) {
#if defined(__AVX512VL__)
    const __mmask8 open = _mm_cmp_ps_mask(alpha, frozen, _CMP_LT_OQ);
    return _mm_maskz_fnmadd_ps(open, opacity, alpha, opacity);
#elif defined(__FMA__)
    return _mm_and_ps((Four)(alpha < frozen), _mm_fnmadd_ps(opacity, alpha, opacity));
#else
    return (Four)((FourBits)(opacity - opacity * alpha) & (alpha < frozen));
#endif
}

#ifdef __AVX2__
inline Eight multiply_add(Eight a, Eight b, Eight c) { return _mm256_fmadd_ps(a, b, c); }

inline Eight behind(Eight opacity, Eight alpha, Eight frozen) {
#ifdef __AVX512VL__
    const __mmask8 open = _mm256_cmp_ps_mask(alpha, frozen, _CMP_LT_OQ);
    return _mm256_maskz_fnmadd_ps(open, opacity, alpha, opacity);
#else
    return _mm256_and_ps((Eight)(alpha < frozen), _mm256_fnmadd_ps(opacity, alpha, opacity));
#endif
}
#endif

#ifdef __AVX512F__
inline Sixteen multiply_add(Sixteen a, Sixteen b, Sixteen c) { return _mm512_fmadd_ps(a, b, c); }

inline Sixteen behind(Sixteen opacity, Sixteen alpha, Sixteen frozen) {
    const __mmask16 open = _mm512_cmp_ps_mask(alpha, frozen, _CMP_LT_OQ);
    return _mm512_maskz_fnmadd_ps(open, opacity, alpha, opacity);
}
#endif

// The widest vectors worth their while for rows of so many pixels, 0 for any number. Where vectors of sixteen are
// about, the machine adds and multiplies shorter ones at two thirds of their rate.
template <int kPixels>
struct Fitting {
    typedef Widest Lanes;
};
template <>
struct Fitting<4> {
    typedef Four Lanes;
};
#ifdef __AVX512F__
template <>
struct Fitting<8> {
    typedef Eight Lanes;
};
template <>
struct Fitting<12> {
    typedef Eight Lanes;
};
#endif

// As `load`, once for all uses: the compiler would rather load again for each.
template <class Lanes>
inline Lanes load_once(const float* address) {
    Lanes lanes = load<Lanes>(address);
#ifdef __x86_64__
    __asm__("" : "+x"(lanes));
#endif
    return lanes;
}

// The opacity A and intensity I of a sample in all lanes, or of one in each.
template <class Lanes>
struct Point {
    Lanes opacity, red, green, blue;
};

template <class Lanes>
inline Point<Lanes> in_all_lanes(float opacity, float red, float green, float blue) {
    return {all_lanes<Lanes>(opacity), all_lanes<Lanes>(red), all_lanes<Lanes>(green), all_lanes<Lanes>(blue)};
}

template <class Lanes, class AllLanes>
__attribute__((always_inline)) inline Point<Lanes> first_of(const Point<AllLanes>& point) {
    return {first_of(point.opacity, Lanes{}), first_of(point.red, Lanes{}), first_of(point.green, Lanes{}),
            first_of(point.blue, Lanes{})};
}

// Some neighbouring pixels of a row.
template <class Lanes>
struct Pixels {
    Lanes red, green, blue, alpha;
};

template <class Lanes>
__attribute__((always_inline)) inline Pixels<Lanes> load_pixels(const float* address, std::int64_t plane) {
    return {load_once<Lanes>(address), load_once<Lanes>(address + plane), load_once<Lanes>(address + 2 * plane),
            load_once<Lanes>(address + 3 * plane)};
}

template <class Lanes>
__attribute__((always_inline)) inline void store_pixels(const Pixels<Lanes>& pixels, float* address,
                                                        std::int64_t plane) {
    store(address, pixels.red), store(address + plane, pixels.green), store(address + 2 * plane, pixels.blue);
    store(address + 3 * plane, pixels.alpha);
}

// Combines a point with pixels that get so much of its opacity; from an alpha of `frozen` on they get nothing.
template <bool kFrontToBack, class Lanes>
__attribute__((always_inline)) inline void combine(Pixels<Lanes>& pixels, Lanes opacity, const Point<Lanes>& point,
                                                   float frozen) {
    if constexpr (kFrontToBack) {
        const Lanes visible = behind(opacity, pixels.alpha, all_lanes<Lanes>(frozen));
        pixels.red = multiply_add(visible, point.red, pixels.red);
        pixels.green = multiply_add(visible, point.green, pixels.green);
        pixels.blue = multiply_add(visible, point.blue, pixels.blue);
        pixels.alpha += visible;
    } else {
        const auto mix = [&](Lanes& channel, Lanes intensity) {
            channel = multiply_add(opacity, intensity - channel, channel);
        };
        mix(pixels.red, point.red), mix(pixels.green, point.green), mix(pixels.blue, point.blue);
        mix(pixels.alpha, all_lanes<Lanes>(1.0f));
    }
}

// min(1, w A)
template <bool kClamped, class Lanes>
__attribute__((always_inline)) inline Lanes opacity_at(const float* weights, const Point<Lanes>& point) {
    const Lanes opacity = load<Lanes>(weights) * point.opacity;
    return kClamped ? at_most_1(opacity) : opacity;
}

// Combines a point with as many pixels as Lanes has, in the four planes of a row.
template <bool kFrontToBack, bool kClamped, class Lanes, class AllLanes>
__attribute__((always_inline)) inline void combine(float* address, std::int64_t plane, const float* weights,
                                                   const Point<AllLanes>& point, float frozen) {
    const Point<Lanes> part = first_of<Lanes>(point);
    Pixels<Lanes> pixels = load_pixels<Lanes>(address, plane);
    combine<kFrontToBack>(pixels, opacity_at<kClamped>(weights, part), part, frozen);
    store_pixels(pixels, address, plane);
}

// The same for so many pixels of a row, a multiple of 4, in the widest vectors that they fill.
template <bool kFrontToBack, bool kClamped, int kPixels, class AllLanes>
__attribute__((always_inline)) inline void combine_pixels(float* pixels, std::int64_t plane, const float* weights,
                                                          const Point<AllLanes>& point, float frozen) {
#ifdef __AVX512F__
    if constexpr (kPixels >= 16) {
        combine<kFrontToBack, kClamped, Sixteen>(pixels, plane, weights, point, frozen);
        combine_pixels<kFrontToBack, kClamped, kPixels - 16>(pixels + 16, plane, weights + 16, point, frozen);
    } else
#endif
#ifdef __AVX2__
        if constexpr (kPixels >= 8) {
        combine<kFrontToBack, kClamped, Eight>(pixels, plane, weights, point, frozen);
        combine_pixels<kFrontToBack, kClamped, kPixels - 8>(pixels + 8, plane, weights + 8, point, frozen);
    } else
#endif
        if constexpr (kPixels >= 4) {
        combine<kFrontToBack, kClamped, Four>(pixels, plane, weights, point, frozen);
        combine_pixels<kFrontToBack, kClamped, kPixels - 4>(pixels + 4, plane, weights + 4, point, frozen);
    }
}

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
