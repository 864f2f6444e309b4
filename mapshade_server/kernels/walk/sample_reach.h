// How far from their positions samples reach, with all that may be rounded on the way to the pixels.
#pragma once

#include <cstdint>

#include "walk_plan.h"

namespace volsplat {

// Places on the screen are 2^-32 pixel.
constexpr int kFractionBits = 32;
constexpr std::int64_t kPixel = std::int64_t{1} << kFractionBits;

struct SampleReach {
    std::int64_t x, y;
};

SampleReach sample_reach(const WalkPlan& plan);

}  // namespace volsplat
