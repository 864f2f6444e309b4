// Combines neighbouring samples whose boxes overlap in the same rows: every pixel is loaded and stored once for all.
#pragma once

#include "pixel_vectors.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

// The lanes first..first+count-1 of a vector, and what they hold with zeros around it.
#ifdef __AVX512VL__
typedef __mmask16 LaneChoice;

inline LaneChoice lanes_from(int first, int count) { return static_cast<LaneChoice>(((1 << count) - 1) << first); }
inline Eight chosen(LaneChoice lanes, Eight values) {
    return _mm256_maskz_mov_ps(static_cast<__mmask8>(lanes), values);
}
inline Sixteen chosen(LaneChoice lanes, Sixteen values) { return _mm512_maskz_mov_ps(lanes, values); }
#else
typedef std::int32_t LaneChoice __attribute__((vector_size(sizeof(Widest))));

inline LaneChoice lanes_from(int first, int count) {
    LaneChoice place;
    for (int n = 0; n < kWidest; ++n) place[n] = n - first;
    return (place >= 0) & (place < count);
}
inline Widest chosen(LaneChoice lanes, Widest values) { return (Widest)(lanes & (LaneChoice)values); }
#endif

// A box of weights, kPixels a row, that lies `shift` pixels right of the window's first.
struct ShiftedBox {
    const float* weights;
    int shift;  // 0..kWindow - kPixels
};

// A window of pixels holds the boxes of so many neighbours, each a quarter of a box further than the one before.
template <bool kFrontToBack, bool kClamped, int kPixels>
class JoinedBoxes {
public:
    static constexpr int kSamples = kPixels <= 8 ? 4 : 2, kWindow = kPixels <= 8 ? 2 * kPixels : kPixels + 4;
    static constexpr bool kFit = kPixels > 0 && kWindow <= kWidest;
    typedef typename Fitting<kWindow>::Lanes Lanes;

    explicit JoinedBoxes(float frozen) : frozen_(frozen) {}

    void set(int n, const ShiftedBox& box, const Point<Lanes>& point) {
        weights_[n] = box.weights - box.shift;
        lanes_[n] = lanes_from(box.shift, kPixels);
        points_[n] = point;
    }

    // Into so many rows of pixels, from the window's first one on.
    __attribute__((always_inline)) void combine_rows(float* address, std::int64_t plane, std::int64_t pitch,
                                                     int rows) const {
        for (std::int64_t weight = 0; rows > 0; --rows, address += pitch, weight += kPixels) {
            Pixels<Lanes> pixels = load_pixels<Lanes>(address, plane);
            for (int n = 0; n < kSamples; ++n) {
                const Lanes opacity = opacity_at<kClamped>(weights_[n] + weight, points_[n]);
                combine<kFrontToBack>(pixels, chosen(lanes_[n], opacity), points_[n], frozen_);
            }
            store_pixels(pixels, address, plane);
        }
    }

private:
    const float frozen_;  // see combine
    const float* weights_[kSamples];
    LaneChoice lanes_[kSamples];
    Point<Lanes> points_[kSamples];
};

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
