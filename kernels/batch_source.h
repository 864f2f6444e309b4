// What hands out the batches of one source, a walking thread, within the process: the map/shade kernels' walkers
// implement it, and the owners of regions take them. Python hands it across as a capsule of this name.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/packet_layout.h"

namespace volsplat {

constexpr char kBatchSourceCapsule[] = "volsplat.BatchSource";

struct BatchPart {  // what of a batch is for one region, in traversal order
    const RowRun* runs;
    std::uint64_t run_count;
    const std::uint64_t* packets;
    std::uint64_t packet_count;
};

struct Step {
    std::vector<BatchPart> parts;             // of each region
    std::int64_t reached_sheet, reached_row;  // nothing that comes later lies before
    bool last;                                // nothing comes later
    std::int64_t voxels_visited;              // those left out as hidden or outside the image included
    std::shared_ptr<const void> memory;       // what the parts lie in
};

class BatchSource {
public:
    virtual ~BatchSource() = default;
    // What comes next. One thread at a time; not called again after the last.
    virtual Step next() = 0;
};

}  // namespace volsplat
