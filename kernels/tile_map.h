// The shape of a map of closed tiles (protocol/rules/closed_tiles.py): rows of tiles, 64 in a word.
#pragma once

#include <cstdint>

#include "kernels/always_inline.h"

namespace volsplat {

constexpr int kTileSide = 4;  // pixels
constexpr int kWordTiles = 64;

VOLSPLAT_INLINE constexpr std::int64_t tile_rows(std::int64_t height) { return (height - 1) / kTileSide + 1; }
VOLSPLAT_INLINE constexpr std::int64_t tile_words(std::int64_t width) {
  return (width - 1) / (kTileSide * kWordTiles) + 1;
}

}  // namespace volsplat
