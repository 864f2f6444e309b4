// The map of closed tiles (protocol/rules/closed_tiles.py): which samples are hidden, and which tiles have become
// closed.
#pragma once

#include "pixel_vectors.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

struct PixelBox {  // within the image, not empty
    int x_begin, x_end, y_begin, y_end;
};

class ClosedTiles {
public:
    ClosedTiles(const ImageView& image, float frozen_alpha) : image_(image), frozen_alpha_(frozen_alpha) {}

    // Whether all tiles under the box are closed.
    bool hide(const PixelBox& box) const {
        for (int row = box.y_begin / kTileSide; row <= (box.y_end - 1) / kTileSide; ++row)
            for (int column = box.x_begin / kTileSide; column <= (box.x_end - 1) / kTileSide; ++column)
                if (!(word_at(row * image_.tile_words + column / 64) >> column % 64 & 1)) return false;
        return true;
    }

    // Marks the tiles of some rows that are closed by now. The first row is a tile's first.
    void look(int row_begin, int row_end) const {
        for (int top = row_begin; top < row_end; top += kTileSide) {
            const int middle = top + (image_.height - top < kTileSide ? 0 : kTileSide / 2);
            const float* const alphas = image_.pixels + middle * image_.pitch + 3 * image_.plane;
            const std::uint64_t* const words = image_.closed_tiles + top / kTileSide * image_.tile_words;
            for (int column = 0; column * kTileSide < image_.width; column += kTilesAtOnce) {
                if ((words[column / 64] >> column % 64 & kAllAtOnce) == kAllAtOnce) continue;  // closed already
                if (any(load<Widest>(alphas + column * kTileSide) >= frozen_alpha_))
                    look_at_some(top / kTileSide, column);
            }
        }
    }

private:
    static constexpr int kTilesAtOnce = kWidest / kTileSide;
    static constexpr std::uint64_t kAllAtOnce = (1 << kTilesAtOnce) - 1;

    // As many tiles as begin in one vector.
    __attribute__((noinline)) void look_at_some(int row, int column) const {
        const int tiles = (image_.width + kTileSide - 1) / kTileSide;
        const int end = column + kTilesAtOnce < tiles ? column + kTilesAtOnce : tiles;
        for (; column < end; ++column) {
            std::uint64_t& word = image_.closed_tiles[row * image_.tile_words + column / 64];
            const std::uint64_t bit = std::uint64_t(1) << column % 64;
            // Others may read the map meanwhile; only the region's owner writes to its rows.
            if (!(word & bit) && frozen(column, row)) __atomic_store_n(&word, word | bit, __ATOMIC_RELAXED);
        }
    }

    // Another region's owner may be writing it.
    std::uint64_t word_at(std::int64_t place) const {
        return __atomic_load_n(&image_.closed_tiles[place], __ATOMIC_RELAXED);
    }

    bool frozen(int column, int row) const {
        const int x_begin = column * kTileSide, y_begin = row * kTileSide;
        const int x_end = x_begin + kTileSide < image_.width ? x_begin + kTileSide : image_.width;
        const int y_end = y_begin + kTileSide < image_.height ? y_begin + kTileSide : image_.height;
        const float* alphas = image_.pixels + y_begin * image_.pitch + 3 * image_.plane;
        if (x_end - x_begin == kTileSide && y_end - y_begin == kTileSide) {  // without a branch for each pixel
            FourBits open{};
            for (int y = 0; y < kTileSide; ++y) open |= load<Four>(alphas + x_begin + y * image_.pitch) < frozen_alpha_;
            return !any(open);
        }
        for (int y = y_begin; y < y_end; ++y, alphas += image_.pitch)
            for (int x = x_begin; x < x_end; ++x)
                if (alphas[x] < frozen_alpha_) return false;
        return true;
    }

    const ImageView image_;
    const float frozen_alpha_;
};

// The same question for boxes of one size that lie well within the image, answered without a branch: for the most
// tiles that such a box can touch.
class ClosedBoxes {
public:
    static constexpr int kMostColumns = 57;  // that one unaligned word is sure to hold

    ClosedBoxes(const ImageView& image, int width, int height)
        : last_left(image.width - kTileSide * most_tiles(width)),
          last_top(image.height - kTileSide * most_tiles(height)),
          tiles_(reinterpret_cast<const unsigned char*>(image.closed_tiles)),
          row_bytes_(image.tile_words * 8),
          rows_(most_tiles(height)),
          all_(most_tiles(width) <= kMostColumns ? (std::uint64_t(1) << most_tiles(width)) - 1 : 0) {}

    // Of a box at 0..last_left, 0..last_top.
    bool hide(std::uint32_t left, std::uint32_t top) const {
        std::int64_t place = top / kTileSide * row_bytes_ + left / (8 * kTileSide);
        const int shift = left / kTileSide % 8;
        std::uint64_t closed = word_at(place);
        for (int row = 1; row < rows_; ++row) closed &= word_at(place += row_bytes_);
        return (closed >> shift & all_) == all_;
    }

    const int last_left, last_top;  // up to there all tiles that a box may touch lie within the image

private:
    static int most_tiles(int pixels) { return (pixels + kTileSide - 2) / kTileSide + 1; }

    // No atomic load, as it lies across words, while another region's owner may be writing them. Bits only rise, and
    // each byte holds them as they were at some time: a read that is torn misses some that have just risen, no more.
    std::uint64_t word_at(std::int64_t place) const {
        std::uint64_t word;
        __builtin_memcpy(&word, tiles_ + place, sizeof word);
        return word;
    }

    const unsigned char* const tiles_;
    const std::int64_t row_bytes_;
    const int rows_;
    const std::uint64_t all_;
};

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
