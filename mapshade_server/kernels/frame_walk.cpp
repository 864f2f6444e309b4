// The loops over sheets, rows and samples, and the cutting of rows into runs and batches.
#include "frame_walk.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "paths/map_shade_kernels.h"

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
    // Most rows lie within
    const std::int64_t last = start + (end - 1) * step;
    if (std::min(start, last) >= low && std::max(start, last) <= high) return;
    if (step < 0) std::swap(low, high);
    begin = std::max(begin, -floor_divided(start - low, step));
    end = std::min(end, floor_divided(high - start, step) + 1);
}

std::size_t longest_row(const std::vector<VisibleRows>& boxes) {
    std::int64_t longest = 0;
    for (const VisibleRows& box : boxes) longest = std::max(longest, box.ordinals(2).count());
    return static_cast<std::size_t>(std::min(longest, kLongestRow));
}

std::vector<VisibleRows> rows_of(const std::vector<PacketBox>& boxes, const WalkPlan& plan,
                                 const Visibility& visibility) {
    std::vector<VisibleRows> rows;
    rows.reserve(boxes.size());
    for (const PacketBox& box : boxes) {
        rows.emplace_back(box, plan, visibility);
        if (rows.back().empty()) rows.pop_back();
    }
    return rows;
}

// The samples of a row whose blocks are of one size: all but what is clipped at either end of the grid.
Ordinals with_equal_blocks(const AxisVisits& visits) {
    const std::int64_t last = visits.count - 1;
    return {visits.clipped(0) ? 1 : 0, visits.clipped(last) ? last : visits.count};
}

std::int64_t reach(double pixels) {
    return (static_cast<std::int64_t>(std::ceil(std::min(pixels, kFarthestReach))) + kReachMargin) * kPixel;
}

}  // namespace

FrameWalk::FrameWalk(const WalkPlan& plan, const ShadingTables& tables, const std::vector<PacketBox>& boxes,
                     const std::uint64_t* closed_tiles)
    : kernels_(map_shade_kernels()),
      plan_(plan),
      tables_(tables),
      equal_blocks_(with_equal_blocks(plan_.visits_of(2))),
      boxes_(rows_of(boxes, plan_, tables.visibility)),
      shading_(plan_, tables_, longest_row(boxes_)),
      left_(-reach(plan.reach_x)),
      right_((plan.width - 1) * kPixel + reach(plan.reach_x)),
      top_(-reach(plan.reach_y)),
      bottom_((plan.height - 1) * kPixel + reach(plan.reach_y)) {
    if (closed_tiles) closed_tiles_.emplace(closed_tiles, plan_);
    finished_ = !find_next_row();
}

void FrameWalk::next_batch(std::size_t max_packets, std::int64_t max_voxels, Batch& batch) {
    batch.runs.clear();
    if (batch.packets.size() < max_packets) batch.packets.resize(max_packets);
    batch.packet_count = 0;
    batch.voxels_visited = 0;
    if (closed_tiles_) closed_tiles_->refresh();
    while (!finished_ && batch.packet_count < max_packets && batch.voxels_visited < max_voxels) {
        if (segment_.visited == segment_.ordinals.count()) {
            if (const std::int64_t skipped = skip_empty_rows(max_voxels - batch.voxels_visited)) {
                batch.voxels_visited += skipped;
                continue;
            }
            open_segment();
        }
        batch.voxels_visited += deliver(max_packets, max_voxels - batch.voxels_visited, batch);
        if (segment_.visited < segment_.ordinals.count()) continue;
        done_ += segment_.visited;
        if (done_ == on_sheet_[box_on_sheet_].rows->ordinals(2).count()) {
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
            if (on_sheet_[box_on_sheet_].traversal.holds(row_)) return true;
        }
        box_on_sheet_ = 0;
        std::int64_t next_row = std::numeric_limits<std::int64_t>::max();
        for (const BoxOnSheet& box : on_sheet_) {
            if (box.traversal.end > row_ + 1) next_row = std::min(next_row, std::max(box.traversal.begin, row_ + 1));
        }
        if (next_row != std::numeric_limits<std::int64_t>::max()) {
            row_ = next_row;
        } else if (!find_next_sheet()) {
            return false;
        }
    }
}

// Moves before the first row of the next sheet that cuts a box.
bool FrameWalk::find_next_sheet() {
    std::int64_t next_sheet = std::numeric_limits<std::int64_t>::max();
    for (const VisibleRows& box : boxes_) {
        const Ordinals sheets = traversal_range(0, box.ordinals(0));
        if (sheets.end > sheet_ + 1) next_sheet = std::min(next_sheet, std::max(sheets.begin, sheet_ + 1));
    }
    if (next_sheet == std::numeric_limits<std::int64_t>::max()) return false;
    sheet_ = next_sheet;
    row_ = -1;
    on_sheet_.clear();
    for (VisibleRows& box : boxes_) {
        if (box.ordinals(0).holds(ordinal(0, sheet_))) on_sheet_.push_back({&box, traversal_range(1, box.ordinals(1))});
    }
    std::sort(on_sheet_.begin(), on_sheet_.end(), [this](const BoxOnSheet& a, const BoxOnSheet& b) {
        return traversal_range(2, a.rows->ordinals(2)).begin < traversal_range(2, b.rows->ordinals(2)).begin;
    });
    return true;
}

// Passes rows that are known to be empty, where they lie in one box; returns how many samples they have.
std::int64_t FrameWalk::skip_empty_rows(std::int64_t max_voxels) {
    if (on_sheet_.size() != 1 || done_ != 0) return 0;
    const BoxOnSheet& box = on_sheet_[0];
    const std::int64_t samples = box.rows->ordinals(2).count();
    const std::int64_t most = std::min(box.traversal.end - row_, max_voxels / samples);
    const std::int64_t rows = box.rows->known_empty(ordinal(0, sheet_), ordinal(1, row_), most);
    if (rows == 0) return 0;
    row_ += rows - 1;
    ++box_on_sheet_;
    finished_ = !find_next_row();
    return rows * samples;
}

// Takes the next samples of the box's row whose blocks are all of one size.
void FrameWalk::open_segment() {
    VisibleRows& rows = *on_sheet_[box_on_sheet_].rows;
    const Ordinals& samples = rows.ordinals(2);
    segment_.ordinals = segment_at(plan_.ascending[2] ? samples.begin + done_ : samples.end - 1 - done_, rows);
    segment_.visited = 0;
    segment_.survivors.voxels.count = 0;
    segment_.sent = 0;
    rows.prefetch_after(ordinal(0, sheet_), ordinal(1, row_));
    if (rows.known_empty(ordinal(0, sheet_), ordinal(1, row_), 1) == 0) shade_segment(rows);
}

// Finds the segment's survivors.
void FrameWalk::shade_segment(VisibleRows& rows) {
    // Leave out what cannot touch the image or is hidden
    const std::int64_t begin = segment_.ordinals.begin;
    SampleRow row = sample_row(begin);
    const RowLine line = line_of(row);
    const Ordinals near = within_reach(line, segment_.ordinals);
    if (near.begin >= near.end) return;
    if (closed_tiles_ && closed_tiles_->hide(line, near.begin - begin, near.end - 1 - begin)) return;

    const VisibleRow visible = rows.row(ordinal(0, sheet_), ordinal(1, row_), near);
    if (visible.voxels.count == 0) return;
    count_from(visible.origin, row);
    segment_.line = line_of(row);
    segment_.origin = visible.origin;
    const VisibleVoxels open =
        closed_tiles_ ? closed_tiles_->without_hidden(segment_.line, visible.voxels) : visible.voxels;
    segment_.survivors = shading_.survivors(row, open);
}

// Delivers what the batch has room for; returns how many samples were visited.
std::int64_t FrameWalk::deliver(std::size_t max_packets, std::int64_t max_voxels, Batch& batch) {
    const std::int64_t before = segment_.visited;
    segment_.visited = std::min(segment_.ordinals.count(), before + max_voxels);
    const std::size_t due = survivors_within(segment_.visited) - segment_.sent;
    const std::size_t room = max_packets - batch.packet_count;
    emit_runs(std::min(due, room), batch);
    // Where the batch is full, go on from the first survivor that was not sent
    if (due > room) segment_.visited = visits_before(segment_.sent);
    return segment_.visited - before;
}

// A clipped block at either end of the grid's row stands alone, so that the samples of a run have equal blocks.
Ordinals FrameWalk::segment_at(std::int64_t ordinal, const VisibleRows& rows) const {
    if (!equal_blocks_.holds(ordinal)) return {ordinal, ordinal + 1};
    const Ordinals piece = rows.piece_of(ordinal);
    return {std::max(piece.begin, equal_blocks_.begin), std::min(piece.end, equal_blocks_.end)};
}

// Samples on the line through that of an ordinal, counted from it.
SampleRow FrameWalk::sample_row(std::int64_t on_line) const {
    SampleRow row;
    row.ordinals[plan_.axes[0]] = ordinal(0, sheet_);
    row.ordinals[plan_.axes[1]] = ordinal(1, row_);
    row.ordinals[plan_.axes[2]] = on_line;
    int block_class = 0;
    for (int axis = 2; axis >= 0; --axis) {
        row.doubled[axis] = plan_.visits[axis].doubled_centre(row.ordinals[axis]);
        block_class = 3 * block_class + plan_.visits[axis].block_class(row.ordinals[axis]);
    }
    row.opacity = tables_.opacity_of_class[block_class];
    return row;
}

void FrameWalk::count_from(std::int64_t origin, SampleRow& row) const {
    const int axis = plan_.axes[2];
    row.doubled[axis] += 2 * plan_.visits[axis].stride * (origin - row.ordinals[axis]);
    row.ordinals[axis] = origin;
}

RowLine FrameWalk::line_of(const SampleRow& row) const {
    const int axis = plan_.axes[2];
    const std::int64_t half_steps = 2 * plan_.visits[axis].stride;
    return {plan_.x.at(row.doubled), plan_.y.at(row.doubled), half_steps * plan_.x.half_steps[axis],
            half_steps * plan_.y.half_steps[axis]};
}

// `line` counts from the first of the samples.
Ordinals FrameWalk::within_reach(const RowLine& line, const Ordinals& samples) const {
    std::int64_t begin = 0, end = samples.count();
    narrow(line.start_x, line.step_x, left_, right_, begin, end);
    narrow(line.start_y, line.step_y, top_, bottom_, begin, end);
    return {samples.begin + begin, samples.begin + end};
}

// The place among the survivors of the n-th in traversal order.
std::size_t FrameWalk::survivor(std::size_t n) const {
    return plan_.ascending[2] ? n : segment_.survivors.voxels.count - 1 - n;
}

// How many samples of the segment come before the n-th survivor in traversal order.
std::int64_t FrameWalk::visits_before(std::size_t n) const {
    const std::int64_t at = segment_.origin + segment_.survivors.voxels.positions[survivor(n)];
    return plan_.ascending[2] ? at - segment_.ordinals.begin : segment_.ordinals.end - 1 - at;
}

// How many survivors the first samples of the segment hold, in traversal order.
std::size_t FrameWalk::survivors_within(std::int64_t visited) const {
    std::size_t low = segment_.sent, high = segment_.survivors.voxels.count;
    if (visited == segment_.ordinals.count()) return high;
    while (low < high) {
        const std::size_t middle = (low + high) / 2;
        if (visits_before(middle) < visited) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

// Cuts the next survivors into runs that a run's offsets can span, in traversal order.
void FrameWalk::emit_runs(std::size_t count, Batch& batch) {
    if (count == 0) return;
    const std::uint16_t* positions = segment_.survivors.voxels.positions;
    const RowLine& line = segment_.line;
    const bool descending = !plan_.ascending[2];
    const std::int64_t step = std::max(std::abs(line.step_x), std::abs(line.step_y));
    const std::int64_t farthest = step <= kLongestRun / kLongestRow ? kLongestRow : kLongestRun / step;
    const std::size_t sending = segment_.sent + count;
    while (segment_.sent < sending) {
        // Find the survivors that are near enough to the run's first
        const std::int64_t head = positions[survivor(segment_.sent)];
        std::size_t end = sending;
        if (std::abs(positions[survivor(sending - 1)] - head) > farthest) {
            end = segment_.sent + 1;
            while (std::abs(positions[survivor(end)] - head) <= farthest) ++end;
        }

        // Place the origin at the smaller position on each axis: one end of the run
        const std::int64_t tail = positions[survivor(end - 1)];
        const std::int32_t origin_x =
            std::min(lattice(line.start_x + head * line.step_x), lattice(line.start_x + tail * line.step_x));
        const std::int32_t origin_y =
            std::min(lattice(line.start_y + head * line.step_y), lattice(line.start_y + tail * line.step_y));
        const std::int64_t head_ordinal = segment_.origin + head;
        const std::int64_t first = descending ? plan_.visits_of(2).count - 1 - head_ordinal : head_ordinal;
        const std::size_t run = end - segment_.sent;
        batch.runs.push_back({static_cast<std::uint32_t>(sheet_), static_cast<std::uint32_t>(row_),
                              static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(run), origin_x, origin_y});
        const std::size_t lowest = descending ? survivor(end - 1) : segment_.sent;
        kernels_.shade(segment_.survivors, tables_.colours, line, {lowest, run, origin_x, origin_y, descending},
                       batch.packets.data() + batch.packet_count);
        batch.packet_count += run;
        segment_.sent = end;
    }
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
