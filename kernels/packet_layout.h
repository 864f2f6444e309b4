// The bits of voxel packets, shaded packets and row runs: protocol/rules/packet_layout.py in C++.
#pragma once

#include <cstdint>

#include "kernels/always_inline.h"

namespace volsplat {

constexpr int kNoDataBit = 31;
constexpr int kDirectionShift = 16;

constexpr int kSubpixelBits = 6;  // positions are multiples of 1/64 pixel
constexpr int kPositionBits = 14;
constexpr int kOpacityShift = 28;
constexpr int kColourShift = 40;

constexpr int kPacketBytes = 8;

constexpr int kPositionMask = (1 << kPositionBits) - 1;
constexpr int kDirectionMask = (1 << (kNoDataBit - kDirectionShift)) - 1;

// Samples of one sheet and row; 24 bytes on the wire.
struct RowRun {
  std::uint32_t sheet, row, first, count;
  std::int32_t x0, y0;  // 1/64 pixel
};

// The bytes need no alignment.
VOLSPLAT_INLINE RowRun run_at(const unsigned char* runs, std::uint64_t n) {
  RowRun run;
  __builtin_memcpy(&run, runs + n * sizeof run, sizeof run);
  return run;
}

}  // namespace volsplat
