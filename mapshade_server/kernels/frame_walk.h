// The walk of a worker's boxes through one frame: traverses in visibility order, maps by DDA, shades, and fills
// batches of shaded packets with a directory of row runs (protocol/packet_layout.py).
#pragma once

#include <cstdint>
#include <vector>

#include "packet_rows.h"
#include "row_shading.h"
#include "walk_plan.h"

namespace volsplat {

// Samples of one sheet and row; 24 bytes on the wire.
struct RowRun {
  std::uint32_t sheet, row, first, count;
  std::int32_t origin_x, origin_y;  // 1/64 pixel
};

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
  FrameWalk(const WalkPlan& plan, const ShadingTables& tables, const std::vector<PacketBox>& boxes);
  FrameWalk(const FrameWalk&) = delete;
  FrameWalk& operator=(const FrameWalk&) = delete;

  // Replaces the batch's content by what comes next, at most so much of it. Limits decide where batches end, never
  // what they hold.
  void next_batch(std::size_t max_packets, std::int64_t max_voxels, Batch& batch);

 private:
  // A part of a box's row, in ordinals, whose blocks are all of one size.
  struct Segment {
    std::int64_t begin, end;
  };

  bool find_next_row();
  Segment segment_at(std::int64_t ordinal, const Ordinals& samples) const;
  std::int64_t walk_segment(PacketRows& box, const Segment& segment, std::size_t max_packets, Batch& batch);
  SampleRow sample_row(const Segment& segment) const;
  RowLine line_of(const SampleRow& row) const;
  Segment within_reach(const RowLine& line, const Segment& segment) const;
  std::size_t emit_runs(const RowLine& line, std::int64_t first_ordinal, std::size_t found, std::size_t max_packets,
                        Batch& batch) const;

  // Traversal order and ordinals run the same way or opposite ways.
  std::int64_t ordinal(int level, std::int64_t traversal) const;
  Ordinals traversal_range(int level, const Ordinals& ordinals) const;

  WalkPlan plan_;
  ShadingTables tables_;
  std::vector<PacketRows> boxes_;
  RowShading shading_;
  std::int64_t left_, right_, top_, bottom_;  // a sample beyond these touches no pixel

  // Where the walk is: sheet and row in traversal order, the box within the row, and samples done of it
  std::int64_t sheet_ = -1, row_ = 0;
  std::vector<PacketRows*> on_sheet_;  // boxes that the sheet cuts, in order of samples
  std::size_t box_on_sheet_ = 0;
  std::int64_t done_ = 0;
  bool finished_ = false;
};

}  // namespace volsplat
