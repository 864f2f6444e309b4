// Which parts of the image no sample can change any more: the map of protocol/rules/closed_tiles.py, read while others
// write it. Bits only rise, so what is read may be old, but it is never wrong.
#pragma once

#include <atomic>
#include <cstdint>

#include "hidden_places.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "regions.h"
#include "sample_reach.h"
#include "walk_plan.h"

namespace volsplat {

class ClosedTiles {
public:
    // For samples that reach some lines, cut between tiles: what they reach beyond does not count. `words` is shaped
    // (tile_rows, tile_words), and outlives this.
    ClosedTiles(const std::uint64_t* words, const WalkPlan& plan, const Lines& lines, std::int64_t walkers);

    // Has `without_hidden` know what is closed by now: to be called before each batch. That takes time, so where many
    // walkers share it, it is done for one batch of so many.
    void refresh() {
        if (batches_.fetch_add(1, std::memory_order_relaxed) % walkers_ == 0) places_.refresh();
    }

    // Whether all samples from position `first` to `last` of a row reach closed tiles only.
    bool hide(const RowLine& line, std::int64_t first, std::int64_t last) const;

    // Leaves out voxels that are hidden; valid until the room is used again.
    VisibleVoxels without_hidden(const RowLine& line, const VisibleVoxels& voxels, VoxelRoom& room) const {
        return places_.without_hidden(from_first_line(line), voxels, room);
    }

private:
    RowLine from_first_line(RowLine line) const;

    // Of the image the lines are looked at from the first one that a sample may reach together with the own ones
    SampleReach reach_;
    std::int64_t first_line_;
    std::int64_t words_in_row_;
    const std::uint64_t* words_;
    std::int64_t width_, height_;
    std::int64_t own_row_;  // of tiles, the first
    HiddenPlaces places_;
    const std::uint64_t walkers_;
    std::atomic<std::uint64_t> batches_{0};
};

}  // namespace volsplat
