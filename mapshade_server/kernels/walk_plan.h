// The numbers of a frame as a walk needs them: protocol/rules/frame_plan.py and protocol/rules/traversal.py in C++.
#pragma once

#include <array>
#include <cstdint>

#include "source_volume.h"

namespace volsplat {

// The indices that a step visits on one axis; see AxisVisits in protocol/rules/traversal.py.
struct AxisVisits {
  std::int64_t low, high, stride, first, count;

  std::int64_t index(std::int64_t ordinal) const { return first + stride * ordinal; }
  std::int64_t block_low(std::int64_t ordinal) const { return ordinal == 0 ? low : index(ordinal) - stride / 2; }
  std::int64_t block_high(std::int64_t ordinal) const {
    return ordinal == count - 1 ? high : index(ordinal) - stride / 2 + stride;
  }
  // Blocks are centred on half voxels.
  std::int64_t doubled_centre(std::int64_t ordinal) const { return block_low(ordinal) + block_high(ordinal) - 1; }
  bool clipped(std::int64_t ordinal) const { return block_high(ordinal) - block_low(ordinal) != stride; }
  // 0 for the first block, 2 for the last, 1 for those between: blocks of a class are of equal size.
  int block_class(std::int64_t ordinal) const { return ordinal == 0 ? 0 : ordinal == count - 1 ? 2 : 1; }
  // The first ordinal whose index is not below `bound`.
  std::int64_t ordinal_from(std::int64_t bound) const {
    const std::int64_t ordinal = bound <= first ? 0 : (bound - first + stride - 1) / stride;
    return ordinal < count ? ordinal : count;
  }
};

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

  const AxisVisits& visits_of(int level) const { return visits[axes[level]]; }
};

}  // namespace volsplat
