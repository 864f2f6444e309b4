// The shape of a map of closed tiles (protocol/rules/closed_tiles.py): rows of tiles, 64 in a word.
#pragma once

#include <cstdint>

#include "kernels/compiler.h"
#include "kernels/constants.h"

namespace volsplat {

static_assert(kWordTiles == 64, "a word is a std::uint64_t");

VOLSPLAT_INLINE constexpr std::int64_t tile_rows(std::int64_t height) { return (height - 1) / kTileSide + 1; }
VOLSPLAT_INLINE constexpr std::int64_t tile_words(std::int64_t width) {
    return (width - 1) / (kTileSide * kWordTiles) + 1;
}

}  // namespace volsplat
