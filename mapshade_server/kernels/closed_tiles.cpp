// Bounding boxes of samples, in tiles.
#include "closed_tiles.h"

#include <algorithm>
#include <cmath>

namespace volsplat {

namespace {

constexpr int kTileShift = 2;  // tiles of 4 x 4 pixels
constexpr int kWordShift = 6;  // of 64 tiles
constexpr int kFractionBits = 32;
constexpr double kMargin = 1.0;  // pixels: positions and the footprint table's offsets are rounded
constexpr std::size_t kStretch = 16;  // voxels that are looked at together
constexpr double kFarthestReach = 1 << 24;

std::int64_t fixed_reach(double pixels) {
  return static_cast<std::int64_t>(std::ceil(std::ldexp(std::min(pixels, kFarthestReach) + kMargin, kFractionBits)));
}

// The tiles on one axis that samples between two places reach, those beyond the image's ends moved into it.
struct TileRange {
  std::int64_t first, last;

  TileRange(std::int64_t a, std::int64_t b, std::int64_t reach, std::int64_t pixels)
      : first(tile(std::min(a, b) - reach, pixels)), last(tile(std::max(a, b) + reach, pixels)) {}

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
  const std::int64_t first_word = columns.first >> kWordShift, last_word = columns.last >> kWordShift;
  for (std::int64_t row = rows.first; row <= rows.last; ++row) {
    for (std::int64_t word = first_word; word <= last_word; ++word) {
      const std::uint64_t wanted = bits_between(word == first_word ? columns.first & 63 : 0,
                                                word == last_word ? columns.last & 63 : 63);
      const std::uint64_t closed = __atomic_load_n(words_ + row * words_in_row_ + word, __ATOMIC_RELAXED);
      if ((wanted & ~closed) != 0) return false;
    }
  }
  return true;
}

VisibleVoxels ClosedTiles::without_hidden(const RowLine& line, const VisibleVoxels& voxels) {
  const auto stretch_end = [&](std::size_t begin) { return std::min(begin + kStretch, voxels.count); };
  const auto hidden = [&](std::size_t begin) {
    return hide(line, voxels.positions[begin], voxels.positions[stretch_end(begin) - 1]);
  };
  // Nothing is copied up to the first stretch that is hidden
  std::size_t kept = 0;
  while (kept < voxels.count && !hidden(kept)) kept = stretch_end(kept);
  if (kept == voxels.count) return voxels;

  if (positions_.size() < voxels.count + kSpare) {
    positions_.resize(voxels.count + kSpare);
    packets_.resize(voxels.count + kSpare);
  }
  const auto copy = [&](std::size_t begin, std::size_t end, std::size_t to) {
    std::copy(voxels.positions + begin, voxels.positions + end, positions_.data() + to);
    std::copy(voxels.packets + begin, voxels.packets + end, packets_.data() + to);
  };
  copy(0, kept, 0);
  for (std::size_t begin = stretch_end(kept); begin < voxels.count; begin = stretch_end(begin)) {
    if (hidden(begin)) continue;
    copy(begin, stretch_end(begin), kept);
    kept += stretch_end(begin) - begin;
  }
  return {positions_.data(), packets_.data(), kept};
}

}  // namespace volsplat
