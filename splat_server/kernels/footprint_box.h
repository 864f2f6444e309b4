// What the weights of a footprint table are computed from.
#pragma once

#include <cstddef>
#include <cstdint>

namespace volsplat {

// Weights are amplitude * P(rho), rho^2 = qxx x^2 + 2 qxy x y + qyy y^2; P is piecewise linear over the half chord
// Z = sqrt(radius^2 - rho^2), 0 where there is none.
struct FootprintBox {
    float qxx, qxy, qyy;
    float radius_square;
    float intervals_per_chord;     // of the table over Z
    const float* over_half_chord;  // amplitude * P, `intervals` + 2 entries, the first 0
    std::int32_t intervals;
    std::int32_t width, height;   // of the box of pixels
    std::int32_t pitch;           // weights from one row to the next; zeros from the width on
    std::int32_t offsets;         // fractional offsets a pixel on each axis
    const std::int32_t* start_x;  // of the box, in pixels from the sample's pixel, for each offset
    const std::int32_t* start_y;
};

}  // namespace volsplat
