// A walk of a frame of slabs: hands out the voxels that are needed, unshaded, by groups of planes from the front to the
// back (protocol/rules/slab_shape.py, protocol/rules/packet_layout.py).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "mapshade_server/kernels/batches/batch_walker.h"
#include "mapshade_server/kernels/walk/regions.h"
#include "mapshade_server/kernels/walk/sample_reach.h"
#include "mapshade_server/kernels/walk/walk_plan.h"
#include "mapshade_server/kernels/walk/walker_parts.h"
#include "needed_rows.h"

namespace volsplat {

struct SlabPlan {
    WalkPlan walk;
    Dda depth;            // planes
    std::int64_t lead;    // planes before plane 0 with which groups begin
    std::int64_t before;  // planes before that below a voxel's depth which it may reach
    std::int64_t groups;
};

struct NeededBox {
    Index3 low, size;
    const std::uint32_t* packets;
    std::shared_ptr<const NeededRows> rows;  // along the samples' axis
};

// What the walkers of a frame share.
struct SlabWalk {
    // As a FrameWalk's.
    SlabWalk(const SlabPlan& plan, std::vector<NeededBox> boxes, const std::vector<Lines>& regions,
             const std::uint64_t* closed_tiles, std::int64_t walkers, const BatchLimits& limits);
    SlabWalk(const SlabWalk&) = delete;
    SlabWalk& operator=(const SlabWalk&) = delete;

    const SlabPlan plan;
    const std::vector<NeededBox> boxes;  // in order of samples
    const Regions regions;
    const std::int64_t reach_x;
    const WalkerParts parts;
    const BatchLimits limits;
};

class SlabWalker : public BatchWalker {
public:
    // The walk outlives its walkers, which are numbered from 0.
    SlabWalker(const SlabWalk& walk, std::int64_t number);
    SlabWalker(const SlabWalker&) = delete;
    SlabWalker& operator=(const SlabWalker&) = delete;

    void next_batch(const BatchLimits& limits, Batch& batch) override;

private:
    // An affine map of sheet, row and sample, in traversal order.
    struct Line {
        std::int64_t start, steps[3];

        std::int64_t at(std::int64_t sheet, std::int64_t row, std::int64_t sample) const {
            return start + sheet * steps[0] + row * steps[1] + sample * steps[2];
        }
    };

    struct Range {
        std::int64_t begin, end;
    };

    struct Window {  // of depths
        std::int64_t low, high;
    };

    Line line_of(const Dda& dda) const;
    Window window(std::int64_t group) const;
    std::int64_t index(int level, std::int64_t ordinal) const;
    bool find_rows();
    bool find_sheets();
    std::int64_t row_number() const;
    std::int64_t walk_row(Batch& batch);
    void deliver(const NeededBox& box, const Range& samples, Batch& batch);
    void leave_out_hidden(const NeededVoxel* begin, const NeededVoxel* end, std::int64_t sample_at_0, Batch& batch);
    void cut_into_regions(const NeededVoxel* begin, const NeededVoxel* end, std::int64_t sample_at_0, Batch& batch);
    void cut_into_runs(const NeededVoxel* begin, const NeededVoxel* end, std::int64_t sample_at_0, ShadedPart& part);

    const SlabWalk& walk_;
    const WalkPlan& plan_;
    const WalkerPart part_;
    const Index3 counts_;  // of sheets, rows and samples
    const Line x_, y_, depth_;
    // Through the groups, in these through the blocks of rows, the sheets and the rows
    std::int64_t group_ = 0, block_ = -1, sheet_ = -1, sheet_end_ = 0, row_ = 0, row_end_ = 0;
    std::size_t delivered_ = 0;  // packets of this batch
    bool finished_ = false;
};

}  // namespace volsplat
