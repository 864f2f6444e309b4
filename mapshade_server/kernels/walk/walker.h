// A walker: walks a part of a worker's boxes through one frame. It traverses in visibility order, maps by DDA, shades,
// and fills batches of shaded packets with directories of row runs (protocol/rules/packet_layout.py).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "mapshade_server/kernels/batches/batch_walker.h"
#include "regions.h"
#include "row_cutter.h"
#include "row_shading.h"
#include "turns.h"
#include "visible_rows.h"
#include "walk_plan.h"
#include "walker_parts.h"

namespace volsplat {

// What the walkers of a frame share. The boxes' packets and the tables are borrowed.
struct FrameWalk {
    // So many walkers, which take turns, or, with 0, one for each region.
    FrameWalk(const WalkPlan& plan, const ShadingTables& tables, const std::vector<PacketBox>& boxes,
              const std::vector<Lines>& regions, const std::uint64_t* closed_tiles, std::int64_t walkers,
              const BatchLimits& limits);
    FrameWalk(const FrameWalk&) = delete;
    FrameWalk& operator=(const FrameWalk&) = delete;

    const WalkPlan plan;
    const ShadingTables tables;
    const std::vector<PacketBox> boxes;
    const Regions regions;
    const WalkerParts parts;
    const Turns turns;
    const BatchLimits limits;
};

class Walker : public BatchWalker {
public:
    // The walk outlives its walkers, which are numbered from 0. One thread at a time may have one walk.
    Walker(const FrameWalk& walk, std::int64_t number);
    Walker(const Walker&) = delete;
    Walker& operator=(const Walker&) = delete;

    void next_batch(const BatchLimits& limits, Batch& batch) override;

private:
    // A box that the sheet cuts, and its rows in traversal order.
    struct BoxOnSheet {
        VisibleRows* rows;
        Ordinals traversal;
    };

    bool find_next_row();
    bool find_next_sheet();
    std::int64_t next_own_row(std::int64_t sheet, std::int64_t row) const;
    Ordinals rows_within_reach(std::int64_t sheet) const;
    std::int64_t skip_empty_rows(std::int64_t max_voxels);
    std::int64_t walk_segment(Batch& batch);
    void shade_segment(VisibleRows& rows, const Ordinals& segment, Batch& batch);
    Ordinals segment_at(std::int64_t ordinal, const VisibleRows& rows) const;
    SampleRow sample_row(std::int64_t on_line) const;
    void count_from(std::int64_t origin, SampleRow& row) const;
    RowLine line_of(const SampleRow& row) const;
    Ordinals within_reach(const RowLine& line, const Ordinals& samples) const;

    // Traversal order and ordinals run the same way or opposite ways.
    std::int64_t ordinal(int level, std::int64_t traversal) const;

    const FrameWalk& walk_;
    const WalkPlan& plan_;
    const WalkerPart part_;
    Ordinals equal_blocks_;
    std::vector<VisibleRows> boxes_;
    RowShading shading_;
    RowCutter cutter_;
    VoxelRoom not_hidden_;
    std::int64_t reach_x_;
    std::size_t ramp_;

    // Where the walk is: sheet and row in traversal order, the box within the row, and samples done of it
    std::int64_t sheet_ = -1, row_ = 0;
    Ordinals near_rows_{0, 0};          // of the sheet, in traversal order: others are out of reach
    std::vector<BoxOnSheet> on_sheet_;  // in order of samples
    std::size_t box_on_sheet_ = 0;
    std::int64_t done_ = 0;
    std::size_t delivered_ = 0;  // packets of this batch
    bool finished_ = false;
};

}  // namespace volsplat
