// How far from their positions samples reach, with all that may be rounded on the way to the pixels.
#pragma once

#include <cstdint>

#include "walk_plan.h"

namespace volsplat {

// 2^-32 pixel.
struct SampleReach {
    std::int64_t x, y;
};

SampleReach sample_reach(const WalkPlan& plan);

}  // namespace volsplat
