// Which parts of the image no sample can change any more: the map of protocol/rules/closed_tiles.py, read while others
// write it. Bits only rise, so what is read may be old, but it is never wrong.
#pragma once

#include <cstdint>

#include "hidden_places.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "sample_reach.h"
#include "walk_plan.h"

namespace volsplat {

class ClosedTiles {
public:
    // `words` is shaped (tile_rows, tile_words), and outlives this.
    ClosedTiles(const std::uint64_t* words, const WalkPlan& plan);

    // Has `without_hidden` know what is closed by now.
    void refresh() { places_.refresh(); }

    // Whether all samples from position `first` to `last` of a row reach closed tiles only.
    bool hide(const RowLine& line, std::int64_t first, std::int64_t last) const;

    // Leaves out voxels that are hidden; valid until the next call.
    VisibleVoxels without_hidden(const RowLine& line, const VisibleVoxels& voxels) {
        return places_.without_hidden(line, voxels);
    }

private:
    const std::uint64_t* words_;
    std::int64_t words_in_row_;
    std::int64_t width_, height_;
    SampleReach reach_;
    HiddenPlaces places_;
};

}  // namespace volsplat
