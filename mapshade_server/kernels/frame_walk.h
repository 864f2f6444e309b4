// The walk of a worker's boxes through one frame: traverses in visibility order, maps by DDA, shades, and fills
// batches of shaded packets with a directory of row runs (protocol/rules/packet_layout.py).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "closed_tiles.h"
#include "kernels/packet_layout.h"
#include "row_shading.h"
#include "visible_rows.h"
#include "walk_plan.h"

namespace volsplat {

struct Batch {
    std::vector<RowRun> runs;
    std::vector<std::uint64_t> packets;  // the first packet_count are filled
    std::size_t packet_count;
    // All that comes before this sheet and row in traversal order has been delivered.
    std::int64_t reached_sheet, reached_row;
    bool last;
    std::int64_t voxels_visited;
};

class FrameWalk {
public:
    // `closed_tiles` is null where nothing may be left out.
    FrameWalk(const WalkPlan& plan, const ShadingTables& tables, const std::vector<PacketBox>& boxes,
              const std::uint64_t* closed_tiles);
    FrameWalk(const FrameWalk&) = delete;
    FrameWalk& operator=(const FrameWalk&) = delete;

    // Replaces the batch's content by what comes next, at most so much of it. Limits decide where batches end, never
    // what they hold.
    void next_batch(std::size_t max_packets, std::int64_t max_voxels, Batch& batch);

private:
    // A box that the sheet cuts, and its rows in traversal order.
    struct BoxOnSheet {
        VisibleRows* rows;
        Ordinals traversal;
    };

    // The part of a box's row that is being delivered: its blocks are all of one size.
    struct Segment {
        Ordinals ordinals{0, 0};
        std::int64_t visited = 0;  // samples, in traversal order
        RowLine line{};
        std::int64_t origin = 0;  // the ordinal at position 0
        SurvivingSamples survivors{};
        std::size_t sent = 0;  // survivors, in traversal order
    };

    bool find_next_row();
    bool find_next_sheet();
    std::int64_t skip_empty_rows(std::int64_t max_voxels);
    void open_segment();
    void shade_segment(VisibleRows& rows);
    std::int64_t deliver(std::size_t max_packets, std::int64_t max_voxels, Batch& batch);
    Ordinals segment_at(std::int64_t ordinal, const VisibleRows& rows) const;
    SampleRow sample_row(std::int64_t on_line) const;
    void count_from(std::int64_t origin, SampleRow& row) const;
    RowLine line_of(const SampleRow& row) const;
    Ordinals within_reach(const RowLine& line, const Ordinals& samples) const;
    std::size_t survivor(std::size_t n) const;
    std::int64_t visits_before(std::size_t n) const;
    std::size_t survivors_within(std::int64_t visited) const;
    void emit_runs(std::size_t count, Batch& batch);

    // Traversal order and ordinals run the same way or opposite ways.
    std::int64_t ordinal(int level, std::int64_t traversal) const;
    Ordinals traversal_range(int level, const Ordinals& ordinals) const;

    const MapShadeKernels& kernels_;
    WalkPlan plan_;
    ShadingTables tables_;
    Ordinals equal_blocks_;
    std::vector<VisibleRows> boxes_;
    RowShading shading_;
    std::optional<ClosedTiles> closed_tiles_;
    std::int64_t left_, right_, top_, bottom_;  // a sample beyond these touches no pixel

    // Where the walk is: sheet and row in traversal order, the box within the row, and samples done before the segment
    std::int64_t sheet_ = -1, row_ = 0;
    std::vector<BoxOnSheet> on_sheet_;  // in order of samples
    std::size_t box_on_sheet_ = 0;
    std::int64_t done_ = 0;
    Segment segment_;
    bool finished_ = false;
};

}  // namespace volsplat
