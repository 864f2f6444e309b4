// The bits of voxel packets, shaded packets and row runs: protocol/rules/packet_layout.py in C++.
#pragma once

#include <cstdint>

#include "kernels/compiler.h"
#include "kernels/constants.h"

namespace volsplat {

constexpr int kPacketBytes = kShadedPacketBytes;
constexpr int kPositionMask = (1 << kPositionBits) - 1;
constexpr int kDirectionMask = kDirectionCodes - 1;
constexpr int kOpacityMask = kOpacityCodes - 1;

static_assert(kNoDataBit == 31 && kDirectionCodes == 1 << (kNoDataBit - kDirectionShift));
static_assert(kOpacityShift == 2 * kPositionBits && kOpacityCodes == 1 << (kColourShift - kOpacityShift));
static_assert(kPacketBytes == sizeof(std::uint64_t));

// Samples of one sheet and row.
struct RowRun {
    std::uint32_t sheet, row, first, count;
    std::int32_t x0, y0;  // 1/64 pixel
};
static_assert(sizeof(RowRun) == kRowRunBytes);

// The bytes need no alignment.
VOLSPLAT_INLINE RowRun run_at(const unsigned char* runs, std::uint64_t n) {
    RowRun run;
    __builtin_memcpy(&run, runs + n * sizeof run, sizeof run);
    return run;
}

}  // namespace volsplat
