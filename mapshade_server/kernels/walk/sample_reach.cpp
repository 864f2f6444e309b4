// Bounds that hold for every way in which samples reach the pixels.
#include "sample_reach.h"

#include <algorithm>
#include <cmath>

namespace volsplat {

namespace {

constexpr double kFarthestReach = 1 << 24;  // pixels; origins of runs are 32 bits

// How far from its row's line a sample may be splatted or looked for, in pixels. Packets round a position by 1/128, the
// offsets of the footprint table by 1/8 at most, unless footprints are so large that the table would not fit;
// `leave_out_hidden` by some bits of a float32, and so do the weights of slanted, flat footprints.
double rounding(const WalkPlan& plan) {
    constexpr double kLargeFootprint = 4096;
    const double offsets = plan.reach_x * plan.reach_y < kLargeFootprint ? 1.0 / 8 : 1.0;
    const double farthest =
        static_cast<double>(std::max(plan.width, plan.height)) + 2 * std::max(plan.reach_x, plan.reach_y);
    return 1.0 / 128 + offsets + std::ldexp(farthest, -22) + 1.0 / 32;
}

std::int64_t fixed(double pixels) {
    return static_cast<std::int64_t>(std::ceil(std::ldexp(std::min(pixels, kFarthestReach), kFractionBits)));
}

}  // namespace

SampleReach sample_reach(const WalkPlan& plan) {
    return {fixed(plan.reach_x + rounding(plan)), fixed(plan.reach_y + rounding(plan))};
}

}  // namespace volsplat
