// Batches as the owners of regions take them.
#include "batch_walker.h"

#include <algorithm>

namespace volsplat {

void BatchWalker::next_batch(std::size_t most_packets, Batch& batch) {
    next_batch({std::min(most_packets, limits_.packets), limits_.voxels}, batch);
}

Step BatchWalker::next() {
    const std::shared_ptr<Batch> batch = free_batch();
    next_batch(limits_, *batch);
    Step step{{}, batch->reached_sheet, batch->reached_row, batch->last, batch->voxels_visited, batch};
    for (const ShadedPart& part : batch->parts) {
        step.parts.push_back({part.runs.data(), part.runs.size(), part.packets.data(), part.packet_count});
    }
    return step;
}

}  // namespace volsplat
