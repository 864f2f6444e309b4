// The numbers of a frame as a walk needs them: protocol/rules/frame_plan.py and protocol/rules/traversal.py in C++.
#pragma once

#include <array>
#include <cstdint>

#include "kernels/axis_visits.h"
#include "kernels/rounding.h"
#include "mapshade_server/kernels/source_volume.h"

namespace volsplat {

// An affine map of the grid in fixed point, 2^-32 of its unit.
struct Dda {
    std::int64_t origin;
    Index3 half_steps;

    std::int64_t at(const Index3& doubled) const {
        return origin + doubled[0] * half_steps[0] + doubled[1] * half_steps[1] + doubled[2] * half_steps[2];
    }
};

struct WalkPlan {
    std::array<int, 3> axes;  // grid axes of sheet, row and sample
    std::array<bool, 3> ascending;
    std::array<AxisVisits, 3> visits;  // of i, j, k
    Dda x, y;                          // pixels
    std::array<Dda, 3> screen_index;   // the fields screen x, y, z: bytes
    std::int64_t width, height;        // of the image, in pixels
    double reach_x, reach_y;           // no sample reaches pixel centres further away than this
    Thresholds thresholds;

    const AxisVisits& visits_of(int level) const { return visits[axes[level]]; }
};

}  // namespace volsplat
