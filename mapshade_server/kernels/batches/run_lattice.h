// How the positions of a row run are rounded, and how long it may be (protocol/rules/packet_layout.py).
#pragma once

#include <cstdint>

#include "kernels/packet_layout.h"
#include "kernels/rounding.h"

namespace volsplat {

// Offsets within a run have kPositionBits, and both ends may round by half a step.
constexpr std::int64_t kLongestRun = std::int64_t{kPositionMask - 1} << kFinerBits;

inline std::int64_t lattice(std::int64_t fixed) {
    return (fixed + (std::int64_t{1} << (kFinerBits - 1))) >> kFinerBits;
}

}  // namespace volsplat
