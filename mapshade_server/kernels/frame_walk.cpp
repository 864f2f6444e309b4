// The loops over sheets, rows and samples, and the cutting of rows into runs and batches.
#include "frame_walk.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "cpu_path.h"

namespace volsplat {

namespace {

constexpr std::int64_t kPixel = std::int64_t{1} << 32;
constexpr double kFarthestReach = 1 << 24;  // pixels; origins of runs are 32 bits
constexpr std::int64_t kReachMargin = 2;    // pixels, for rounding on either side
// Offsets within a run have 14 bits, and both ends may round by half a step.
constexpr std::int64_t kLongestRun = std::int64_t{16382} << 26;

std::int64_t floor_divided(std::int64_t a, std::int64_t b) {
  const std::int64_t quotient = a / b;
  return quotient * b != a && (a < 0) != (b < 0) ? quotient - 1 : quotient;
}

std::int32_t lattice(std::int64_t fixed) { return static_cast<std::int32_t>((fixed + (std::int64_t{1} << 25)) >> 26); }

// Narrows begin..end to the n with low <= start + n * step <= high.
void narrow(std::int64_t start, std::int64_t step, std::int64_t low, std::int64_t high, std::int64_t& begin,
            std::int64_t& end) {
  if (step == 0) {
    if (start < low || start > high) end = begin;
    return;
  }
  if (step < 0) std::swap(low, high);
  begin = std::max(begin, -floor_divided(start - low, step));
  end = std::min(end, floor_divided(high - start, step) + 1);
}

std::size_t longest_row(const std::vector<PacketRows>& boxes) {
  std::int64_t longest = 0;
  for (const PacketRows& box : boxes) longest = std::max(longest, box.ordinals(2).count());
  return static_cast<std::size_t>(longest);
}

std::vector<PacketRows> rows_of(const std::vector<PacketBox>& boxes, const WalkPlan& plan) {
  std::vector<PacketRows> rows;
  for (const PacketBox& box : boxes) {
    rows.emplace_back(box, plan);
    if (rows.back().empty()) rows.pop_back();
  }
  return rows;
}

std::int64_t reach(double pixels) {
  return (static_cast<std::int64_t>(std::ceil(std::min(pixels, kFarthestReach))) + kReachMargin) * kPixel;
}

}  // namespace

FrameWalk::FrameWalk(const WalkPlan& plan, const ShadingTables& tables, const std::vector<PacketBox>& boxes)
    : plan_(plan),
      tables_(tables),
      boxes_(rows_of(boxes, plan_)),
      shading_(plan_, tables_, longest_row(boxes_)),
      left_(-reach(plan.reach_x)),
      right_((plan.width - 1) * kPixel + reach(plan.reach_x)),
      top_(-reach(plan.reach_y)),
      bottom_((plan.height - 1) * kPixel + reach(plan.reach_y)) {
  finished_ = !find_next_row();
}

void FrameWalk::next_batch(std::size_t max_packets, std::int64_t max_voxels, Batch& batch) {
  batch.runs.clear();
  if (batch.packets.size() < max_packets) batch.packets.resize(max_packets);
  batch.packet_count = 0;
  batch.voxels_visited = 0;
  while (!finished_ && batch.packet_count < max_packets && batch.voxels_visited < max_voxels) {
    // Take the rest of the segment that comes next, cut to the budget
    PacketRows& box = *on_sheet_[box_on_sheet_];
    const Ordinals& samples = box.ordinals(2);
    const bool ascending = plan_.ascending[2];
    const std::int64_t next = ascending ? samples.begin + done_ : samples.end - 1 - done_;
    Segment segment = segment_at(next, samples);
    const std::int64_t budget = max_voxels - batch.voxels_visited;
    if (ascending) {
      segment = {next, std::min(segment.end, next + budget)};
    } else {
      segment = {std::max(segment.begin, next + 1 - budget), next + 1};
    }

    const std::int64_t visited = walk_segment(box, segment, max_packets, batch);
    done_ += visited;
    batch.voxels_visited += visited;
    if (done_ == samples.count()) {
      done_ = 0;
      ++box_on_sheet_;
      finished_ = !find_next_row();
    }
  }
  batch.last = finished_;
  batch.reached_sheet = finished_ ? plan_.visits_of(0).count : sheet_;
  batch.reached_row = finished_ ? 0 : row_;
}

// Moves on to the next box of this row, the next row or the next sheet that holds samples.
bool FrameWalk::find_next_row() {
  while (true) {
    for (; box_on_sheet_ < on_sheet_.size(); ++box_on_sheet_) {
      if (on_sheet_[box_on_sheet_]->ordinals(1).holds(ordinal(1, row_))) return true;
    }
    box_on_sheet_ = 0;
    std::int64_t next_row = std::numeric_limits<std::int64_t>::max();
    for (const PacketRows* box : on_sheet_) {
      const Ordinals rows = traversal_range(1, box->ordinals(1));
      if (rows.end > row_ + 1) next_row = std::min(next_row, std::max(rows.begin, row_ + 1));
    }
    if (next_row != std::numeric_limits<std::int64_t>::max()) {
      row_ = next_row;
      continue;
    }

    // No row is left: find the next sheet that cuts a box
    std::int64_t next_sheet = std::numeric_limits<std::int64_t>::max();
    for (const PacketRows& box : boxes_) {
      const Ordinals sheets = traversal_range(0, box.ordinals(0));
      if (sheets.end > sheet_ + 1) next_sheet = std::min(next_sheet, std::max(sheets.begin, sheet_ + 1));
    }
    if (next_sheet == std::numeric_limits<std::int64_t>::max()) return false;
    sheet_ = next_sheet;
    row_ = -1;
    on_sheet_.clear();
    for (PacketRows& box : boxes_) {
      if (box.ordinals(0).holds(ordinal(0, sheet_))) on_sheet_.push_back(&box);
    }
    std::sort(on_sheet_.begin(), on_sheet_.end(), [this](const PacketRows* a, const PacketRows* b) {
      return traversal_range(2, a->ordinals(2)).begin < traversal_range(2, b->ordinals(2)).begin;
    });
    box_on_sheet_ = on_sheet_.size();
  }
}

// A clipped block at either end of the grid's row stands alone, so that the samples of a run have equal blocks.
FrameWalk::Segment FrameWalk::segment_at(std::int64_t ordinal, const Ordinals& samples) const {
  const AxisVisits& visits = plan_.visits_of(2);
  const std::int64_t last = visits.count - 1;
  if (visits.clipped(ordinal)) return {ordinal, ordinal + 1};
  return {std::max(samples.begin, visits.clipped(0) ? std::int64_t{1} : 0),
          std::min(samples.end, visits.clipped(last) ? last : visits.count)};
}

// Delivers a segment's visible samples; returns how many samples it got through before the batch was full.
std::int64_t FrameWalk::walk_segment(PacketRows& box, const Segment& segment, std::size_t max_packets, Batch& batch) {
  // Leave out what cannot touch the image
  const Segment near = within_reach(line_of(sample_row(segment)), segment);
  const std::int64_t all = segment.end - segment.begin;
  if (near.begin >= near.end) return all;

  const SampleRow row = sample_row(near);
  const RowLine line = line_of(row);
  const std::uint32_t* packets = box.row(ordinal(0, sheet_), ordinal(1, row_)) + (near.begin - box.ordinals(2).begin);
  const std::size_t found = shading_.select(row, packets, static_cast<std::size_t>(near.end - near.begin));
  const std::size_t sent = emit_runs(line, near.begin, found, max_packets, batch);
  if (sent == found) return all;

  // The batch is full: go on from the first sample that was not sent
  const std::size_t next = plan_.ascending[2] ? sent : found - 1 - sent;
  const std::int64_t next_ordinal = near.begin + shading_.survivors().positions[next];
  return plan_.ascending[2] ? next_ordinal - segment.begin : segment.end - 1 - next_ordinal;
}

SampleRow FrameWalk::sample_row(const Segment& segment) const {
  SampleRow row;
  row.ordinals[plan_.axes[0]] = ordinal(0, sheet_);
  row.ordinals[plan_.axes[1]] = ordinal(1, row_);
  row.ordinals[plan_.axes[2]] = segment.begin;
  int block_class = 0;
  for (int axis = 2; axis >= 0; --axis) {
    row.doubled[axis] = plan_.visits[axis].doubled_centre(row.ordinals[axis]);
    block_class = 3 * block_class + plan_.visits[axis].block_class(row.ordinals[axis]);
  }
  row.opacity = tables_.opacity_of_class[block_class];
  return row;
}

RowLine FrameWalk::line_of(const SampleRow& row) const {
  const int axis = plan_.axes[2];
  const std::int64_t half_steps = 2 * plan_.visits[axis].stride;
  return {plan_.x.at(row.doubled), plan_.y.at(row.doubled), half_steps * plan_.x.half_steps[axis],
          half_steps * plan_.y.half_steps[axis]};
}

FrameWalk::Segment FrameWalk::within_reach(const RowLine& line, const Segment& segment) const {
  std::int64_t begin = 0, end = segment.end - segment.begin;
  narrow(line.start_x, line.step_x, left_, right_, begin, end);
  narrow(line.start_y, line.step_y, top_, bottom_, begin, end);
  return {segment.begin + begin, segment.begin + end};
}

// Cuts the survivors into runs that a run's offsets can span, in traversal order; returns how many were sent.
std::size_t FrameWalk::emit_runs(const RowLine& line, std::int64_t first_ordinal, std::size_t found,
                                 std::size_t max_packets, Batch& batch) const {
  const SurvivingSamples survivors = shading_.survivors();
  const bool descending = !plan_.ascending[2];
  const std::int64_t step = std::max(std::abs(line.step_x), std::abs(line.step_y));
  const std::int64_t farthest = step == 0 ? std::numeric_limits<std::int32_t>::max() : kLongestRun / step;
  const std::size_t sending = std::min(found, max_packets - batch.packet_count);
  std::size_t sent = 0;
  while (sent < sending) {
    // Find the survivors that are near enough to the run's first
    const auto at = [&](std::size_t n) { return descending ? found - 1 - n : n; };
    const std::int64_t head = survivors.positions[at(sent)];
    std::size_t end = sending;
    if (std::abs(survivors.positions[at(sending - 1)] - head) > farthest) {
      end = sent + 1;
      while (std::abs(survivors.positions[at(end)] - head) <= farthest) ++end;
    }

    // Place the origin at the smaller position on each axis: one end of the run
    const std::int64_t tail = survivors.positions[at(end - 1)];
    const std::int32_t origin_x =
        std::min(lattice(line.start_x + head * line.step_x), lattice(line.start_x + tail * line.step_x));
    const std::int32_t origin_y =
        std::min(lattice(line.start_y + head * line.step_y), lattice(line.start_y + tail * line.step_y));
    const std::int64_t head_ordinal = first_ordinal + head;
    const std::int64_t first = descending ? plan_.visits_of(2).count - 1 - head_ordinal : head_ordinal;
    batch.runs.push_back({static_cast<std::uint32_t>(sheet_), static_cast<std::uint32_t>(row_),
                          static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(end - sent), origin_x,
                          origin_y});
    path_kernels().shade(survivors, tables_.colours, line, origin_x, origin_y, at(sent), end - sent, descending,
                         batch.packets.data() + batch.packet_count);
    batch.packet_count += end - sent;
    sent = end;
  }
  return sent;
}

std::int64_t FrameWalk::ordinal(int level, std::int64_t traversal) const {
  return plan_.ascending[level] ? traversal : plan_.visits_of(level).count - 1 - traversal;
}

Ordinals FrameWalk::traversal_range(int level, const Ordinals& ordinals) const {
  if (plan_.ascending[level]) return ordinals;
  const std::int64_t count = plan_.visits_of(level).count;
  return {count - ordinals.end, count - ordinals.begin};
}

}  // namespace volsplat
