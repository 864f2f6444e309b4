// The indices that a step visits on one axis; see AxisVisits in protocol/rules/traversal.py.
#pragma once

#include <cstdint>

#include "kernels/compiler.h"

namespace volsplat {

struct AxisVisits {
    std::int64_t low, high, stride, first, count;

    VOLSPLAT_INLINE std::int64_t index(std::int64_t ordinal) const { return first + stride * ordinal; }
    // Where the block of an ordinal begins, but for the outermost ones, which reach to the bounds.
    VOLSPLAT_INLINE std::int64_t block_start(std::int64_t ordinal) const { return index(ordinal) - stride / 2; }
    VOLSPLAT_INLINE std::int64_t block_low(std::int64_t ordinal) const {
        return ordinal == 0 ? low : block_start(ordinal);
    }
    VOLSPLAT_INLINE std::int64_t block_high(std::int64_t ordinal) const {
        return ordinal == count - 1 ? high : block_start(ordinal) + stride;
    }
    // Blocks are centred on half voxels.
    VOLSPLAT_INLINE std::int64_t doubled_centre(std::int64_t ordinal) const {
        return block_low(ordinal) + block_high(ordinal) - 1;
    }
    VOLSPLAT_INLINE bool clipped(std::int64_t ordinal) const {
        return block_high(ordinal) - block_low(ordinal) != stride;
    }
    // 0 for the first block, 2 for the last, 1 for those between: blocks of a class are of equal size.
    VOLSPLAT_INLINE int block_class(std::int64_t ordinal) const {
        return ordinal == 0 ? 0 : ordinal == count - 1 ? 2 : 1;
    }
    // The first ordinal whose index is not below `bound`.
    VOLSPLAT_INLINE std::int64_t ordinal_from(std::int64_t bound) const {
        const std::int64_t ordinal = bound <= first ? 0 : (bound - first + stride - 1) / stride;
        return ordinal < count ? ordinal : count;
    }
};

}  // namespace volsplat
