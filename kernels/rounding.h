// How positions are rounded: protocol/rules/rounding.py in C++.
#pragma once

#include <cstdint>

#include "kernels/compiler.h"
#include "kernels/constants.h"

namespace volsplat {

constexpr int kFinerBits = 32 - kSubpixelBits;  // of a position in 2^-32 pixel, beyond those of a packet

struct Thresholds {
    std::uint64_t first, step;  // whatever they are, sums wrap

    // Of a sheet: its upper bits are those of a footprint's offset, its lower ones those of a position.
    VOLSPLAT_INLINE std::uint32_t of(std::uint64_t sheet) const {
        return static_cast<std::uint32_t>(first + sheet * step);
    }

    // What to add to a position in 2^-32 pixel, so that rounding it to the nearest 1/64 pixel keeps to the threshold.
    VOLSPLAT_INLINE std::int64_t shift_of(std::uint64_t sheet) const {
        constexpr std::int64_t kUnit = std::int64_t{1} << kFinerBits;
        return (of(sheet) & (kUnit - 1)) - kUnit / 2;
    }
};

}  // namespace volsplat
