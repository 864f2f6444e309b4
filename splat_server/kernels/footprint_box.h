// What the weights of a footprint table are computed from.
#pragma once

#include <cstddef>
#include <cstdint>

namespace volsplat {

// Numbers that may be read behind those of a band's weights: a vector of any instruction set.
constexpr std::size_t kBandMargin = 16;

// Weights are amplitude * P(rho), rho^2 = qxx x^2 + 2 qxy x y + qyy y^2; P is piecewise linear over the half chord
// Z = sqrt(radius^2 - rho^2), 0 where there is none.
struct FootprintBox {
    float qxx;
    float radius_square;
    float intervals_per_chord;     // of the table over Z
    const float* over_half_chord;  // amplitude * P, `intervals` + 2 entries, the first 0
    std::int32_t intervals;
    std::int32_t offsets;         // fractional offsets a pixel on each axis
    const std::int32_t* start_x;  // of the box, in pixels from the sample's pixel, for each offset along x
    std::size_t weights;          // of a box, padding included
    const float* x;               // of each weight of a band, in pixels from the box's start; far away for padding
};

// Some whole rows of the boxes of a row of offsets, which are all at one fraction of y.
struct FootprintBand {
    std::size_t count;      // of weights in a box
    const float* along_y;   // qyy y^2 of each
    const float* twice_xy;  // 2 qxy y
};

}  // namespace volsplat
