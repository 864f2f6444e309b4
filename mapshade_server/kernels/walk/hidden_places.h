// Where on the image samples are hidden, worked out from the map of closed tiles for a frame's reach.
#pragma once

#include <cstdint>
#include <vector>

#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "sample_reach.h"

namespace volsplat {

class HiddenPlaces {
public:
    // `tiles` is shaped (rows of tiles, words of each), may be written meanwhile, and outlives this.
    HiddenPlaces(const std::uint64_t* tiles, std::int64_t width, std::int64_t height, const SampleReach& reach);

    // Takes over what has been closed since the last time.
    void refresh();

    // Leaves out hidden voxels of a row; valid until the next call.
    VisibleVoxels without_hidden(const RowLine& line, const VisibleVoxels& voxels);

private:
    bool take_over(std::int64_t tile_row);
    void join_columns(std::int64_t tile_row);
    void join_rows(std::int64_t tile_row);
    void join_row(std::int64_t tile_row, std::uint32_t* hidden);

    const MapShadeKernels& kernels_;
    const std::uint64_t* tiles_;
    const std::int64_t width_, height_, tile_rows_, tile_words_;
    const SampleReach reach_;
    const std::int64_t box_width_, box_height_;  // pixels that a sample can reach
    const std::int64_t words_;                   // of a row of pixels
    std::vector<std::uint64_t> known_tiles_;
    std::vector<char> changed_;          // of each row of tiles, since the last time
    std::vector<std::uint32_t> closed_;  // of each row of tiles: bit x tells that pixels x..x+box_width-1 are closed
    std::vector<std::uint32_t> hidden_;  // of each row of pixels: bit x tells that the box from (x, row) on is closed
    std::vector<std::uint16_t> positions_;
    std::vector<std::uint32_t> packets_;
};

}  // namespace volsplat
