// The loops over sheets, rows and samples, and what of them can be left out.
#include "walker.h"

#include <algorithm>
#include <cstdlib>
#include <limits>

#include "narrow.h"

namespace volsplat {

namespace {

constexpr std::int64_t kNone = std::numeric_limits<std::int64_t>::max();
// Of all walkers' first batches; then doubled, so that the splatter soon has something to do.
constexpr std::int64_t kFirstPackets = 4096;

Ordinals in_traversal_order(const WalkPlan& plan, int level, const Ordinals& ordinals) {
    if (plan.ascending[level]) return ordinals;
    const std::int64_t count = plan.visits_of(level).count;
    return {count - ordinals.end, count - ordinals.begin};
}

std::size_t longest_row(const std::vector<VisibleRows>& boxes) {
    std::int64_t longest = 0;
    for (const VisibleRows& box : boxes) longest = std::max(longest, box.ordinals(2).count());
    return static_cast<std::size_t>(std::min(longest, kLongestRow));
}

std::vector<VisibleRows> rows_of(const FrameWalk& walk) {
    std::vector<VisibleRows> rows;
    rows.reserve(walk.boxes.size());
    for (const PacketBox& box : walk.boxes) {
        rows.emplace_back(box, walk.plan, walk.tables.visibility, walk.turns.spread());
        if (rows.back().empty()) rows.pop_back();
    }
    return rows;
}

// Whether blocks of a class on an axis have other opacities than those between the ends.
bool differs(const std::array<int, 27>& opacity_of_class, int axis, int block_class) {
    const int digit = axis == 0 ? 1 : axis == 1 ? 3 : 9;
    for (int n = 0; n < 27; ++n) {
        if (n / digit % 3 == 1 && opacity_of_class[n] != opacity_of_class[n + (block_class - 1) * digit]) return true;
    }
    return false;
}

// The samples of a row whose blocks are alike: all but what is clipped at either end of the grid, or reaches beyond.
Ordinals with_equal_blocks(const WalkPlan& plan, const std::array<int, 27>& opacity_of_class) {
    const AxisVisits& visits = plan.visits_of(2);
    const std::int64_t last = visits.count - 1;
    const bool first_alone = visits.clipped(0) || differs(opacity_of_class, plan.axes[2], 0);
    const bool last_alone = visits.clipped(last) || differs(opacity_of_class, plan.axes[2], 2);
    return {first_alone ? 1 : 0, last_alone ? last : visits.count};
}

// How many sheets or rows there are from the first one to the last that boxes have.
std::int64_t extent(const WalkPlan& plan, const std::vector<PacketBox>& boxes, int level) {
    std::int64_t begin = kNone, end = 0;
    for (const PacketBox& box : boxes) {
        const Ordinals own = visited_of(box, plan, level);
        begin = std::min(begin, own.begin);
        end = std::max(end, own.end);
    }
    return std::max<std::int64_t>(0, end - begin);
}

}  // namespace

FrameWalk::FrameWalk(const WalkPlan& plan_, const ShadingTables& tables_, const std::vector<PacketBox>& boxes_,
                     const std::vector<Lines>& regions_, const std::uint64_t* closed_tiles_, std::int64_t walkers,
                     const BatchLimits& limits_)
    : plan(plan_),
      tables(tables_),
      boxes(boxes_),
      regions(regions_, plan),
      parts(plan, regions_, regions, walkers, closed_tiles_),
      turns(plan, parts.taking_turns(), extent(plan, boxes, 0), extent(plan, boxes, 1),
            boxes.empty() ? 0 : boxes[0].low[0]),
      limits(limits_) {}

Walker::Walker(const FrameWalk& walk, std::int64_t number)
    : BatchWalker(walk.limits),
      walk_(walk),
      plan_(walk.plan),
      part_(walk.parts.of(number)),
      equal_blocks_(with_equal_blocks(plan_, walk.tables.opacity_of_class)),
      boxes_(rows_of(walk)),
      shading_(plan_, walk.tables, longest_row(boxes_)),
      cutter_(plan_, walk.regions, walk.tables.colours),
      reach_x_(sample_reach(plan_).x),
      ramp_(static_cast<std::size_t>(std::max<std::int64_t>(1, kFirstPackets / walk.parts.count()))) {
    finished_ = part_.places.least > part_.places.greatest || !find_next_row();
}

void Walker::next_batch(const BatchLimits& limits, Batch& batch) {
    batch.begin(walk_.parts.batch_parts());
    delivered_ = 0;
    const std::size_t most = std::min(limits.packets, ramp_);
    ramp_ = 2 * most;
    if (part_.closed_tiles) part_.closed_tiles->refresh();
    while (!finished_ && delivered_ < most && batch.voxels_visited < limits.voxels) {
        const std::int64_t skipped = skip_empty_rows(limits.voxels - batch.voxels_visited);
        batch.voxels_visited += skipped != 0 ? skipped : walk_segment(batch);
    }
    batch.last = finished_;
    batch.reached_sheet = finished_ ? plan_.visits_of(0).count : sheet_;
    batch.reached_row = finished_ ? 0 : row_;
}

// Moves on to the next box of this row, the next row or the next sheet that holds samples for this walker.
bool Walker::find_next_row() {
    while (true) {
        for (; box_on_sheet_ < on_sheet_.size(); ++box_on_sheet_) {
            if (on_sheet_[box_on_sheet_].traversal.holds(row_)) return true;
        }
        box_on_sheet_ = 0;
        const std::int64_t next = next_own_row(sheet_, row_ + 1);
        std::int64_t next_row = kNone;
        for (const BoxOnSheet& box : on_sheet_) {
            if (box.traversal.end > next) next_row = std::min(next_row, std::max(box.traversal.begin, next));
        }
        if (next_row == kNone) {
            if (!find_next_sheet()) return false;
        } else if (next_row == next) {
            row_ = next;
        } else {
            row_ = next_row - 1;  // it may be another walker's
        }
    }
}

// Moves before the first row of the next sheet that cuts a box and has rows for this walker.
bool Walker::find_next_sheet() {
    std::int64_t next = sheet_;
    do {
        const std::int64_t from = next + 1;
        next = kNone;
        for (const VisibleRows& box : boxes_) {
            const Ordinals sheets = in_traversal_order(plan_, 0, box.ordinals(0));
            if (sheets.end > from) next = std::min(next, std::max(sheets.begin, from));
        }
        if (next == kNone) return false;
        near_rows_ = rows_within_reach(next);
    } while (next_own_row(next, 0) == walk_.turns.rows());
    sheet_ = next;
    row_ = -1;
    on_sheet_.clear();
    for (VisibleRows& box : boxes_) {
        if (!box.ordinals(0).holds(ordinal(0, sheet_))) continue;
        on_sheet_.push_back({&box, in_traversal_order(plan_, 1, box.ordinals(1))});
    }
    const auto first_sample = [this](const BoxOnSheet& box) {
        return in_traversal_order(plan_, 2, box.rows->ordinals(2)).begin;
    };
    std::sort(on_sheet_.begin(), on_sheet_.end(),
              [&](const BoxOnSheet& a, const BoxOnSheet& b) { return first_sample(a) < first_sample(b); });
    return true;
}

// As Turns::next_row, without those that are out of reach.
std::int64_t Walker::next_own_row(std::int64_t sheet, std::int64_t row) const {
    const std::int64_t own = walk_.turns.next_row(part_.turn, sheet, std::max(row, near_rows_.begin));
    return own < near_rows_.end ? own : walk_.turns.rows();
}

// In traversal order; others of a sheet cannot reach the walker's places.
Ordinals Walker::rows_within_reach(std::int64_t sheet) const {
    const AxisVisits &rows = plan_.visits_of(1), &samples = plan_.visits_of(2);
    SampleRow row;
    const auto place = [&](int level, std::int64_t doubled) { row.doubled[plan_.axes[level]] = doubled; };
    const auto doubled = [&](std::int64_t at) { return 2 * rows.block_start(at) + rows.stride - 1; };
    place(0, plan_.visits_of(0).doubled_centre(ordinal(0, sheet)));
    place(1, doubled(ordinal(1, 0)));
    place(2, samples.doubled_centre(0));
    const std::int64_t last = rows.count - 1;
    const std::int64_t clipped =
        std::max(std::abs(rows.doubled_centre(0) - doubled(0)), std::abs(rows.doubled_centre(last) - doubled(last)));
    const std::int64_t off = clipped * std::abs(plan_.y.half_steps[plan_.axes[1]]);
    const std::int64_t along =
        (samples.doubled_centre(samples.count - 1) - samples.doubled_centre(0)) * plan_.y.half_steps[plan_.axes[2]];
    const std::int64_t step = (plan_.ascending[1] ? 2 : -2) * rows.stride * plan_.y.half_steps[plan_.axes[1]];
    Ordinals near{0, rows.count};
    narrow(plan_.y.at(row.doubled) + plan_.thresholds.shift_of(static_cast<std::uint64_t>(sheet)), step,
           part_.places.least - std::max<std::int64_t>(0, along) - off,
           part_.places.greatest - std::min<std::int64_t>(0, along) + off, near.begin, near.end);
    return near;
}

// Passes rows that are known to be empty, where they lie in one box; returns how many samples they have.
std::int64_t Walker::skip_empty_rows(std::int64_t max_voxels) {
    if (on_sheet_.size() != 1 || done_ != 0) return 0;
    const BoxOnSheet& box = on_sheet_[0];
    const std::int64_t samples = box.rows->ordinals(2).count();
    const std::int64_t end = std::min({box.traversal.end, near_rows_.end, walk_.turns.block_end(row_)});
    const std::int64_t most = std::min(end - row_, max_voxels / samples);
    const std::int64_t rows = box.rows->known_empty(ordinal(0, sheet_), ordinal(1, row_), most);
    if (rows == 0) return 0;
    row_ += rows - 1;
    ++box_on_sheet_;
    finished_ = !find_next_row();
    return rows * samples;
}

// Walks the next samples of the box's row whose blocks are all of one size; returns how many they are.
std::int64_t Walker::walk_segment(Batch& batch) {
    VisibleRows& rows = *on_sheet_[box_on_sheet_].rows;
    const Ordinals& samples = rows.ordinals(2);
    const Ordinals segment = segment_at(plan_.ascending[2] ? samples.begin + done_ : samples.end - 1 - done_, rows);
    rows.prefetch_after(ordinal(0, sheet_), ordinal(1, row_));
    if (rows.known_empty(ordinal(0, sheet_), ordinal(1, row_), 1) == 0) shade_segment(rows, segment, batch);
    done_ += segment.count();
    if (done_ == samples.count()) {
        done_ = 0;
        ++box_on_sheet_;
        finished_ = !find_next_row();
    }
    return segment.count();
}

void Walker::shade_segment(VisibleRows& rows, const Ordinals& segment, Batch& batch) {
    // Leave out what cannot touch the image or is hidden
    const std::int64_t begin = segment.begin;
    SampleRow row = sample_row(begin);
    const RowLine line = line_of(row);
    const Ordinals near = within_reach(line, segment);
    if (near.begin >= near.end) return;
    if (part_.closed_tiles && part_.closed_tiles->hide(line, near.begin - begin, near.end - 1 - begin)) return;

    const VisibleRow visible = rows.row(ordinal(0, sheet_), ordinal(1, row_), near);
    if (visible.voxels.count == 0) return;
    count_from(visible.origin, row);
    const RowLine counted = line_of(row);
    const VisibleVoxels open =
        part_.closed_tiles ? part_.closed_tiles->without_hidden(counted, visible.voxels, not_hidden_) : visible.voxels;
    delivered_ += cutter_.deliver({sheet_, row_, visible.origin, counted, shading_.survivors(row, open)}, batch);
}

// A clipped block at either end of the grid's row stands alone, so that the samples of a run have equal blocks.
Ordinals Walker::segment_at(std::int64_t ordinal, const VisibleRows& rows) const {
    if (!equal_blocks_.holds(ordinal)) return {ordinal, ordinal + 1};
    const Ordinals piece = rows.piece_of(ordinal);
    return {std::max(piece.begin, equal_blocks_.begin), std::min(piece.end, equal_blocks_.end)};
}

// Samples on the line through that of an ordinal, counted from it.
SampleRow Walker::sample_row(std::int64_t on_line) const {
    SampleRow row;
    row.ordinals[plan_.axes[0]] = ordinal(0, sheet_);
    row.ordinals[plan_.axes[1]] = ordinal(1, row_);
    row.ordinals[plan_.axes[2]] = on_line;
    int block_class = 0;
    for (int axis = 2; axis >= 0; --axis) {
        row.doubled[axis] = plan_.visits[axis].doubled_centre(row.ordinals[axis]);
        block_class = 3 * block_class + plan_.visits[axis].block_class(row.ordinals[axis]);
    }
    row.opacity = walk_.tables.opacity_of_class[block_class];
    return row;
}

void Walker::count_from(std::int64_t origin, SampleRow& row) const {
    const int axis = plan_.axes[2];
    row.doubled[axis] += 2 * plan_.visits[axis].stride * (origin - row.ordinals[axis]);
    row.ordinals[axis] = origin;
}

// To be rounded to the nearest.
RowLine Walker::line_of(const SampleRow& row) const {
    const int axis = plan_.axes[2];
    const std::int64_t half_steps = 2 * plan_.visits[axis].stride;
    const std::int64_t shift = plan_.thresholds.shift_of(static_cast<std::uint64_t>(sheet_));
    return {plan_.x.at(row.doubled) + shift, plan_.y.at(row.doubled) + shift, half_steps * plan_.x.half_steps[axis],
            half_steps * plan_.y.half_steps[axis]};
}

// `line` counts from the first of the samples.
Ordinals Walker::within_reach(const RowLine& line, const Ordinals& samples) const {
    std::int64_t begin = 0, end = samples.count();
    narrow(line.start_x, line.step_x, -reach_x_, (plan_.width - 1) * kPixel + reach_x_, begin, end);
    narrow(line.start_y, line.step_y, part_.places.least, part_.places.greatest, begin, end);
    return {samples.begin + begin, samples.begin + end};
}

std::int64_t Walker::ordinal(int level, std::int64_t traversal) const {
    return plan_.ascending[level] ? traversal : plan_.visits_of(level).count - 1 - traversal;
}

}  // namespace volsplat
