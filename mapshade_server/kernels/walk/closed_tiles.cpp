// Bounding boxes of samples, in tiles.
#include "closed_tiles.h"

#include <algorithm>

#include "kernels/tile_map.h"

namespace volsplat {

namespace {

constexpr std::int64_t kAlmostPixel = kPixel - 1;  // rounds up to the next pixel's centre

// The tiles on one axis that samples between two places reach, those beyond the image's ends moved into it.
struct TileRange {
    std::int64_t first, last;

    TileRange(std::int64_t a, std::int64_t b, std::int64_t reach, std::int64_t pixels)
        : first(tile(std::min(a, b) - reach + kAlmostPixel, pixels)), last(tile(std::max(a, b) + reach, pixels)) {}

    static std::int64_t tile(std::int64_t place, std::int64_t pixels) {
        return std::clamp<std::int64_t>(place >> kFractionBits, 0, pixels - 1) / kTileSide;
    }
};

// All bits from `first` to `last`.
std::uint64_t bits_between(std::int64_t first, std::int64_t last) {
    return (~std::uint64_t{0} << first) & (~std::uint64_t{0} >> (63 - last));
}

}  // namespace

ClosedTiles::ClosedTiles(const std::uint64_t* words, const WalkPlan& plan, const Lines& lines, std::int64_t walkers)
    : reach_(sample_reach(plan)),
      first_line_(std::max<std::int64_t>(0, lines.begin - (2 * reach_.y >> kFractionBits)) / kTileSide * kTileSide),
      words_in_row_(tile_words(plan.width)),
      words_(words + first_line_ / kTileSide * words_in_row_),
      width_(plan.width),
      height_(lines.end - first_line_),
      own_row_((lines.begin - first_line_) / kTileSide),
      places_(words_, width_, height_, own_row_, reach_),
      walkers_(static_cast<std::uint64_t>(walkers)) {}

RowLine ClosedTiles::from_first_line(RowLine line) const {
    line.start_y -= first_line_ << kFractionBits;
    return line;
}

bool ClosedTiles::hide(const RowLine& in_image, std::int64_t first, std::int64_t last) const {
    const RowLine line = from_first_line(in_image);
    const TileRange columns(line.start_x + first * line.step_x, line.start_x + last * line.step_x, reach_.x, width_);
    const TileRange rows(line.start_y + first * line.step_y, line.start_y + last * line.step_y, reach_.y, height_);
    const std::int64_t last_word = columns.last / kWordTiles;
    for (std::int64_t word = columns.first / kWordTiles; word <= last_word; ++word) {
        const std::int64_t from = std::max(columns.first, word * kWordTiles);
        const std::int64_t to = std::min(columns.last, (word + 1) * kWordTiles - 1);
        const std::uint64_t wanted = bits_between(from % kWordTiles, to % kWordTiles);
        const std::int64_t first_row = std::max(rows.first, own_row_);
        const std::uint64_t* at = words_ + first_row * words_in_row_ + word;
        for (std::int64_t row = first_row; row <= rows.last; ++row, at += words_in_row_) {
            if ((wanted & ~__atomic_load_n(at, __ATOMIC_RELAXED)) != 0) return false;
        }
    }
    return true;
}

}  // namespace volsplat
