// Which parts of the image no sample can change any more: the map of protocol/closed_tiles.py, read while others write
// it. Bits only rise, so what is read may be old, but it is never wrong.
#pragma once

#include <cstdint>
#include <vector>

#include "paths/path_kernels.h"
#include "walk_plan.h"

namespace volsplat {

class ClosedTiles {
 public:
  // `words` is shaped (rows of tiles, words of each), and outlives this.
  ClosedTiles(const std::uint64_t* words, const WalkPlan& plan);

  // How many rows, and words of each, the map of such an image has.
  static std::int64_t rows(std::int64_t height);
  static std::int64_t words(std::int64_t width);

  // Whether all samples from position `first` to `last` of a row reach closed tiles only.
  bool hide(const RowLine& line, std::int64_t first, std::int64_t last) const;

  // Leaves out stretches of voxels that are hidden; valid until the next call.
  VisibleVoxels without_hidden(const RowLine& line, const VisibleVoxels& voxels);

 private:
  const std::uint64_t* words_;
  std::int64_t words_in_row_;
  std::int64_t width_, height_;
  std::int64_t reach_x_, reach_y_;  // 2^-32 pixel
  std::vector<std::uint16_t> positions_;
  std::vector<std::uint32_t> packets_;
};

}  // namespace volsplat
