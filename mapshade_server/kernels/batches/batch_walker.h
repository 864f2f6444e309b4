// What every walker is: a source of batches.
#pragma once

#include <cstddef>
#include <cstdint>

#include "batch.h"
#include "kernels/batch_source.h"

namespace volsplat {

// Where batches end, at the least: on the next whole row, or piece of a long one.
struct BatchLimits {
    std::size_t packets;
    std::int64_t voxels;
};

class BatchWalker : public BatchSource {
public:
    // Replaces the batch's content by what comes next. Limits decide where batches end, never what they hold together;
    // a frame's first batches may be smaller.
    virtual void next_batch(const BatchLimits& limits, Batch& batch) = 0;

    // With the walk's own limits, or fewer packets.
    void next_batch(std::size_t most_packets, Batch& batch);

    Step next() final;

protected:
    explicit BatchWalker(const BatchLimits& limits) : limits_(limits) {}

private:
    const BatchLimits limits_;
};

}  // namespace volsplat
