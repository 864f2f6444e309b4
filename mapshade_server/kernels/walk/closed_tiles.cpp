// Bounding boxes of samples, in tiles.
#include "closed_tiles.h"

#include <algorithm>

#include "kernels/tile_map.h"

namespace volsplat {

namespace {

constexpr int kFractionBits = 32;
constexpr std::int64_t kAlmostPixel = (std::int64_t{1} << kFractionBits) - 1;  // rounds up to the next pixel's centre

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

ClosedTiles::ClosedTiles(const std::uint64_t* words, const WalkPlan& plan, std::int64_t walkers)
    : words_(words),
      words_in_row_(tile_words(plan.width)),
      width_(plan.width),
      height_(plan.height),
      reach_(sample_reach(plan)),
      places_(words, plan.width, plan.height, reach_),
      walkers_(static_cast<std::uint64_t>(walkers)) {}

bool ClosedTiles::hide(const RowLine& line, std::int64_t first, std::int64_t last) const {
    const TileRange columns(line.start_x + first * line.step_x, line.start_x + last * line.step_x, reach_.x, width_);
    const TileRange rows(line.start_y + first * line.step_y, line.start_y + last * line.step_y, reach_.y, height_);
    const std::int64_t last_word = columns.last / kWordTiles;
    for (std::int64_t word = columns.first / kWordTiles; word <= last_word; ++word) {
        const std::int64_t from = std::max(columns.first, word * kWordTiles);
        const std::int64_t to = std::min(columns.last, (word + 1) * kWordTiles - 1);
        const std::uint64_t wanted = bits_between(from % kWordTiles, to % kWordTiles);
        const std::uint64_t* at = words_ + rows.first * words_in_row_ + word;
        for (std::int64_t row = rows.first; row <= rows.last; ++row, at += words_in_row_) {
            if ((wanted & ~__atomic_load_n(at, __ATOMIC_RELAXED)) != 0) return false;
        }
    }
    return true;
}

}  // namespace volsplat
