// Where on the image samples are hidden, worked out from the map of closed tiles for a frame's reach. Walkers read it
// while one of them takes over what is new: bits only rise, so what is read may be old, but it is never wrong.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <vector>

#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "sample_reach.h"

namespace volsplat {

// Room for voxels of one row that are left.
struct VoxelRoom {
    std::vector<std::uint16_t> positions;
    std::vector<std::uint32_t> packets;
};

class HiddenPlaces {
public:
    // `tiles` is shaped (rows of tiles, words of each), may be written meanwhile, and outlives this. Rows before
    // `first_row` do not count: they are taken for closed.
    HiddenPlaces(const std::uint64_t* tiles, std::int64_t width, std::int64_t height, std::int64_t first_row,
                 const SampleReach& reach);

    // Takes over what has been closed since the last time, unless another thread is at it.
    void refresh();

    // Leaves out hidden voxels of a row; valid until the room is used again.
    VisibleVoxels without_hidden(const RowLine& line, const VisibleVoxels& voxels, VoxelRoom& room) const;

private:
    bool take_over(std::int64_t tile_row);
    void join_columns(std::int64_t tile_row);
    void join_rows(std::int64_t tile_row);
    void join_row(std::int64_t tile_row, std::uint32_t* hidden) const;
    void publish(std::int64_t row, const std::uint32_t* hidden);

    const MapShadeKernels& kernels_;
    const std::uint64_t* tiles_;
    const std::int64_t width_, height_, first_row_, tile_rows_, tile_words_;
    const SampleReach reach_;
    const std::int64_t box_width_, box_height_;  // pixels that a sample can reach
    const std::int64_t words_;                   // of a row of pixels
    std::vector<std::uint32_t> hidden_;  // of each row of pixels: bit x tells that the box from (x, row) on is closed
    std::atomic<bool> any_{false};       // whether one is

    std::mutex mutex_;  // guards what follows
    std::vector<std::uint64_t> known_tiles_;
    std::vector<char> changed_;          // of each row of tiles, since the last time
    std::vector<std::uint32_t> closed_;  // of each row of tiles: bit x tells that pixels x..x+box_width-1 are closed
    std::vector<std::uint32_t> next_;    // hidden places of a row of pixels
};

}  // namespace volsplat
