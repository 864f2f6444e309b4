// Bounding boxes of samples, in tiles.
#include "closed_tiles.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace volsplat {

namespace {

constexpr int kTileShift = 2;  // tiles of 4 x 4 pixels
constexpr int kWordShift = 6;
constexpr std::int64_t kWordTiles = 64;
constexpr int kFractionBits = 32;
constexpr std::int64_t kAlmostPixel = (std::int64_t{1} << kFractionBits) - 1;  // rounds up to the next pixel's centre
constexpr double kMargin = 0.51;  // pixels: positions are rounded by 1/128, the footprint table's offsets by up to 1/2
constexpr std::size_t kStretch = 16;  // voxels that are looked at together
constexpr double kFarthestReach = 1 << 24;

std::int64_t fixed_reach(double pixels) {
  return static_cast<std::int64_t>(std::ceil(std::ldexp(std::min(pixels, kFarthestReach) + kMargin, kFractionBits)));
}

// The tiles on one axis that samples between two places reach, those beyond the image's ends moved into it.
struct TileRange {
  std::int64_t first, last;

  TileRange(std::int64_t a, std::int64_t b, std::int64_t reach, std::int64_t pixels)
      : first(tile(std::min(a, b) - reach + kAlmostPixel, pixels)), last(tile(std::max(a, b) + reach, pixels)) {}

  static std::int64_t tile(std::int64_t place, std::int64_t pixels) {
    return std::clamp<std::int64_t>(place >> kFractionBits, 0, pixels - 1) >> kTileShift;
  }
};

// All bits from `first` to `last`.
std::uint64_t bits_between(std::int64_t first, std::int64_t last) {
  return (~std::uint64_t{0} << first) & (~std::uint64_t{0} >> (63 - last));
}

}  // namespace

ClosedTiles::ClosedTiles(const std::uint64_t* words, const WalkPlan& plan)
    : words_(words),
      words_in_row_(ClosedTiles::words(plan.width)),
      width_(plan.width),
      height_(plan.height),
      reach_x_(fixed_reach(plan.reach_x)),
      reach_y_(fixed_reach(plan.reach_y)) {}

std::int64_t ClosedTiles::rows(std::int64_t height) { return ((height - 1) >> kTileShift) + 1; }

std::int64_t ClosedTiles::words(std::int64_t width) { return ((width - 1) >> (kTileShift + kWordShift)) + 1; }

bool ClosedTiles::hide(const RowLine& line, std::int64_t first, std::int64_t last) const {
  const TileRange columns(line.start_x + first * line.step_x, line.start_x + last * line.step_x, reach_x_, width_);
  const TileRange rows(line.start_y + first * line.step_y, line.start_y + last * line.step_y, reach_y_, height_);
  const std::int64_t last_word = columns.last >> kWordShift;
  for (std::int64_t word = columns.first >> kWordShift; word <= last_word; ++word) {
    const std::int64_t from = std::max(columns.first, word << kWordShift);
    const std::int64_t to = std::min(columns.last, (word << kWordShift) + kWordTiles - 1);
    const std::uint64_t wanted = bits_between(from % kWordTiles, to % kWordTiles);
    const std::uint64_t* at = words_ + rows.first * words_in_row_ + word;
    for (std::int64_t row = rows.first; row <= rows.last; ++row, at += words_in_row_) {
      if ((wanted & ~__atomic_load_n(at, __ATOMIC_RELAXED)) != 0) return false;
    }
  }
  return true;
}

VisibleVoxels ClosedTiles::without_hidden(const RowLine& line, const VisibleVoxels& voxels) {
  if (positions_.size() < voxels.count + kSpare) {
    positions_.resize(voxels.count + kSpare);
    packets_.resize(voxels.count + kSpare);
  }
  std::size_t kept = 0;
  for (std::size_t begin = 0; begin < voxels.count; begin += kStretch) {
    // Whole stretches are copied, the spare elements behind the last one too
    std::memcpy(positions_.data() + kept, voxels.positions + begin, kStretch * sizeof(std::uint16_t));
    std::memcpy(packets_.data() + kept, voxels.packets + begin, kStretch * sizeof(std::uint32_t));
    const std::size_t count = std::min(kStretch, voxels.count - begin);
    const bool hidden = hide(line, voxels.positions[begin], voxels.positions[begin + count - 1]);
    kept += hidden ? 0 : count;
  }
  return {positions_.data(), packets_.data(), kept};
}

}  // namespace volsplat
