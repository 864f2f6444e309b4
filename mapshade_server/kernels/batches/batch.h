// What a walker delivers at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/packet_layout.h"

namespace volsplat {

// What of a batch is for one region, in traversal order.
struct ShadedPart {
    std::vector<RowRun> runs;
    std::vector<std::uint64_t> packets;  // the first packet_count are filled
    std::size_t packet_count = 0;

    // Where so many more packets are to be written.
    std::uint64_t* append(std::size_t more);
};

struct Batch {
    std::vector<ShadedPart> parts;
    // All that the walker has before this sheet and row in traversal order has been delivered.
    std::int64_t reached_sheet, reached_row;
    bool last;
    std::int64_t voxels_visited;

    // Empties it, but keeps its memory.
    void begin(std::size_t regions);
    // Of all parts.
    std::size_t packet_count() const;
};

// Batches are used again, by later walks too, once nobody else holds them. Any thread may ask.
std::shared_ptr<Batch> free_batch();

}  // namespace volsplat
