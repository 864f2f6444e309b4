// Depth is linear along rows, so that each group's part of a row is found by arithmetic.
#include "slab_walk.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "mapshade_server/kernels/batches/run_lattice.h"
#include "mapshade_server/kernels/walk/narrow.h"

namespace volsplat {

namespace {

constexpr int kFinerDepth = 32 - kDepthBits;
constexpr std::int64_t kRowCost = 16;       // of looking for a row's voxels, in voxels
constexpr std::int64_t kLookedAtOnce = 16;  // voxels of a row, for whether they are hidden
constexpr std::int64_t kTurnRows = 4;       // rows next to each other stay with a walker

std::int64_t lattice_depth(std::int64_t fixed) {
    return (fixed + (std::int64_t{1} << (kFinerDepth - 1))) >> kFinerDepth;
}

const NeededVoxel* from_position(const NeededVoxel* begin, const NeededVoxel* end, std::int64_t position) {
    const auto before = [](const NeededVoxel& voxel, std::int64_t at) { return voxel.position < at; };
    return std::lower_bound(begin, end, position, before);
}

// In order of samples.
std::vector<NeededBox> sorted(std::vector<NeededBox> boxes, const WalkPlan& plan) {
    const int axis = plan.axes[2];
    std::sort(boxes.begin(), boxes.end(), [&](const NeededBox& a, const NeededBox& b) {
        return plan.ascending[2] ? a.low[axis] < b.low[axis] : a.low[axis] > b.low[axis];
    });
    return boxes;
}

}  // namespace

SlabWalk::SlabWalk(const SlabPlan& plan_, std::vector<NeededBox> boxes_, const std::vector<Lines>& regions_,
                   const std::uint64_t* closed_tiles_, std::int64_t walkers, const BatchLimits& limits_)
    : plan(plan_),
      boxes(sorted(std::move(boxes_), plan.walk)),
      regions(regions_, plan.walk),
      reach_x(sample_reach(plan.walk).x),
      parts(plan.walk, regions_, regions, walkers, closed_tiles_),
      limits(limits_) {}

SlabWalker::SlabWalker(const SlabWalk& walk, std::int64_t number)
    : BatchWalker(walk.limits),
      walk_(walk),
      plan_(walk.plan.walk),
      part_(walk.parts.of(number)),
      counts_{plan_.visits_of(0).count, plan_.visits_of(1).count, plan_.visits_of(2).count},
      x_(line_of(plan_.x)),
      y_(line_of(plan_.y)),
      depth_(line_of(walk.plan.depth)) {
    finished_ = walk_.boxes.empty() || part_.places.least > part_.places.greatest || !find_rows();
}

void SlabWalker::next_batch(const BatchLimits& limits, Batch& batch) {
    batch.begin(walk_.parts.batch_parts());
    delivered_ = 0;
    while (!finished_ && delivered_ < limits.packets && batch.voxels_visited < limits.voxels) {
        const std::int64_t turn = row_number() / kTurnRows;
        if (turn % walk_.parts.taking_turns() == part_.turn) batch.voxels_visited += walk_row(batch);
        if (++row_ == row_end_) finished_ = !find_rows();
    }
    batch.last = finished_;
    batch.reached_sheet = finished_ ? walk_.plan.groups : group_;
    batch.reached_row = finished_ ? 0 : row_number();
}

SlabWalker::Line SlabWalker::line_of(const Dda& dda) const {
    Index3 first{};
    Line line{0, {}};
    for (int level = 0; level < 3; ++level) {
        const int axis = plan_.axes[level];
        first[axis] = 2 * index(level, 0);
        line.steps[level] = (plan_.ascending[level] ? 2 : -2) * dda.half_steps[axis];
    }
    line.start = dda.at(first);
    return line;
}

std::int64_t SlabWalker::index(int level, std::int64_t ordinal) const {
    const AxisVisits& visits = plan_.visits_of(level);
    return visits.low + (plan_.ascending[level] ? ordinal : visits.count - 1 - ordinal);
}

// The depths of a group's voxels.
SlabWalker::Window SlabWalker::window(std::int64_t group) const {
    const std::int64_t first = kGroupPlanes * group - walk_.plan.lead + walk_.plan.before;
    const std::int64_t half = std::int64_t{1} << (kFinerDepth - 1);
    return {first * kPixel - half, (first + kGroupPlanes) * kPixel - half - 1};
}

// See packet_layout.
std::int64_t SlabWalker::row_number() const { return (block_ * counts_[0] + sheet_) * kBlockRows + row_ % kBlockRows; }

// Moves on to the next sheet's rows that may have any of a group's voxels.
bool SlabWalker::find_rows() {
    const std::int64_t across = (counts_[2] - 1) * depth_.steps[2], along = (counts_[2] - 1) * y_.steps[2];
    do {
        const Window depths = window(group_);
        while (++sheet_ < sheet_end_) {
            Range rows{block_ * kBlockRows, std::min((block_ + 1) * kBlockRows, counts_[1])};
            narrow(depth_.at(sheet_, 0, 0), depth_.steps[1], depths.low - std::max<std::int64_t>(0, across),
                   depths.high - std::min<std::int64_t>(0, across), rows.begin, rows.end);
            narrow(y_.at(sheet_, 0, 0), y_.steps[1], part_.places.least - std::max<std::int64_t>(0, along),
                   part_.places.greatest - std::min<std::int64_t>(0, along), rows.begin, rows.end);
            if (rows.begin >= rows.end) continue;
            row_ = rows.begin, row_end_ = rows.end;
            return true;
        }
    } while (find_sheets());
    return false;
}

// Moves on to the next block of rows, and its sheets that may have any of a group's voxels.
bool SlabWalker::find_sheets() {
    const std::int64_t across = (counts_[2] - 1) * depth_.steps[2], up = (kBlockRows - 1) * depth_.steps[1];
    const std::int64_t least = std::min<std::int64_t>(0, across) + std::min<std::int64_t>(0, up);
    const std::int64_t greatest = std::max<std::int64_t>(0, across) + std::max<std::int64_t>(0, up);
    for (; group_ < walk_.plan.groups; ++group_, block_ = -1) {
        const Window depths = window(group_);
        while (++block_ * kBlockRows < counts_[1]) {
            Range sheets{0, counts_[0]};
            narrow(depth_.at(0, block_ * kBlockRows, 0), depth_.steps[0], depths.low - greatest, depths.high - least,
                   sheets.begin, sheets.end);
            if (sheets.begin >= sheets.end) continue;
            sheet_ = sheets.begin - 1, sheet_end_ = sheets.end;
            return true;
        }
    }
    return false;
}

// Returns what it has cost.
std::int64_t SlabWalker::walk_row(Batch& batch) {
    const Window depths = window(group_);
    Range samples{0, counts_[2]};
    narrow(depth_.at(sheet_, row_, 0), depth_.steps[2], depths.low, depths.high, samples.begin, samples.end);
    narrow(x_.at(sheet_, row_, 0), x_.steps[2], -walk_.reach_x, (plan_.width - 1) * kPixel + walk_.reach_x,
           samples.begin, samples.end);
    narrow(y_.at(sheet_, row_, 0), y_.steps[2], part_.places.least, part_.places.greatest, samples.begin, samples.end);
    if (samples.begin >= samples.end) return kRowCost;
    for (const NeededBox& box : walk_.boxes) deliver(box, samples, batch);
    return kRowCost + samples.end - samples.begin;
}

void SlabWalker::deliver(const NeededBox& box, const Range& samples, Batch& batch) {
    Index3 place{};
    for (int level = 0; level < 2; ++level) {
        const int axis = plan_.axes[level];
        place[axis] = index(level, level == 0 ? sheet_ : row_) - box.low[axis];
        if (place[axis] < 0 || place[axis] >= box.size[axis]) return;
    }
    // Positions in the box, whichever way it is walked
    const int axis = plan_.axes[2];
    const bool ascending = plan_.ascending[2];
    const std::int64_t one = index(2, samples.begin) - box.low[axis], other = index(2, samples.end - 1) - box.low[axis];
    const NeededRow row = box.rows->row(place, box.packets);
    const NeededVoxel* const begin = from_position(row.begin, row.end, std::min(one, other));
    const NeededVoxel* const end = from_position(begin, row.end, std::max(one, other) + 1);
    if (begin == end) return;

    leave_out_hidden(begin, end, samples.begin - (ascending ? one : -one), batch);
}

// Some neighbours at a time. `sample_at_0` is that at position 0.
void SlabWalker::leave_out_hidden(const NeededVoxel* begin, const NeededVoxel* end, std::int64_t sample_at_0,
                                  Batch& batch) {
    if (!part_.closed_tiles) return cut_into_regions(begin, end, sample_at_0, batch);
    const std::int64_t towards = plan_.ascending[2] ? 1 : -1;
    const RowLine line{x_.at(sheet_, row_, sample_at_0), y_.at(sheet_, row_, sample_at_0), towards * x_.steps[2],
                       towards * y_.steps[2]};
    const std::int64_t count = end - begin;
    std::int64_t open = 0;  // what is to be cut, before what is being looked at; in traversal order
    const auto cut = [&](std::int64_t from, std::int64_t to) {
        if (from == to) return;
        if (towards > 0) cut_into_regions(begin + from, begin + to, sample_at_0, batch);
        else cut_into_regions(end - to, end - from, sample_at_0, batch);
    };
    for (std::int64_t n = 0; n < count; n += kLookedAtOnce) {
        const std::int64_t next = std::min(n + kLookedAtOnce, count);
        const NeededVoxel& first = towards > 0 ? begin[n] : end[-next];
        const NeededVoxel& last = towards > 0 ? begin[next - 1] : end[-n - 1];
        if (!part_.closed_tiles->hide(line, first.position, last.position)) continue;
        cut(open, n);
        open = next;
    }
    cut(open, count);
}

void SlabWalker::cut_into_regions(const NeededVoxel* begin, const NeededVoxel* end, std::int64_t sample_at_0,
                                  Batch& batch) {
    if (batch.parts.size() == 1) return cut_into_runs(begin, end, sample_at_0, batch.parts[0]);
    const std::int64_t towards = plan_.ascending[2] ? 1 : -1;
    const std::int64_t start = y_.at(sheet_, row_, sample_at_0), step = towards * y_.steps[2];
    const std::int64_t first = begin->position, last = end[-1].position;
    const Regions::Range reached = walk_.regions.reached(start + first * step, start + last * step);
    for (std::size_t region = reached.first; region <= reached.last; ++region) {
        const Regions::Places& places = walk_.regions.places(region);
        std::int64_t from = first, to = last + 1;
        narrow(start, step, places.least, places.greatest, from, to);
        if (from >= to) continue;
        const NeededVoxel* const own = from_position(begin, end, from);
        cut_into_runs(own, from_position(own, end, to), sample_at_0, batch.parts[region]);
    }
}

// In traversal order.
void SlabWalker::cut_into_runs(const NeededVoxel* begin, const NeededVoxel* end, std::int64_t sample_at_0,
                               ShadedPart& part) {
    const std::int64_t towards = plan_.ascending[2] ? 1 : -1;
    const auto sample = [&](const NeededVoxel& voxel) { return sample_at_0 + towards * voxel.position; };
    const std::int64_t x0 = x_.at(sheet_, row_, 0), y0 = y_.at(sheet_, row_, 0);
    const std::int64_t depth0 = depth_.at(sheet_, row_, 0);
    const std::int64_t first_depth = (kGroupPlanes * group_ - walk_.plan.lead + walk_.plan.before) * (1 << kDepthBits);
    const std::int64_t step = std::max(std::abs(x_.steps[2]), std::abs(y_.steps[2]));
    const std::int64_t farthest = step == 0 ? counts_[2] : kLongestRun / step;
    const std::int64_t count = end - begin;
    const auto voxel = [&](std::int64_t n) { return begin[towards > 0 ? n : count - 1 - n]; };
    for (std::int64_t done = 0; done < count;) {
        const std::int64_t head = sample(voxel(done));
        std::int64_t run = 1;
        while (done + run < count && sample(voxel(done + run)) - head <= farthest) ++run;
        const std::int64_t tail = sample(voxel(done + run - 1));
        const std::int64_t origin_x = std::min(lattice(x0 + head * x_.steps[2]), lattice(x0 + tail * x_.steps[2]));
        const std::int64_t origin_y = std::min(lattice(y0 + head * y_.steps[2]), lattice(y0 + tail * y_.steps[2]));
        part.runs.push_back({static_cast<std::uint32_t>(group_), static_cast<std::uint32_t>(row_number()),
                             static_cast<std::uint32_t>(head), static_cast<std::uint32_t>(run),
                             static_cast<std::int32_t>(origin_x), static_cast<std::int32_t>(origin_y)});
        std::uint64_t* out = part.append(static_cast<std::size_t>(run));
        for (std::int64_t n = 0; n < run; ++n) {
            const NeededVoxel one = voxel(done + n);
            const std::int64_t at = sample(one);
            const auto x = static_cast<std::uint64_t>(lattice(x0 + at * x_.steps[2]) - origin_x);
            const auto y = static_cast<std::uint64_t>(lattice(y0 + at * y_.steps[2]) - origin_y);
            const auto depth = static_cast<std::uint64_t>(lattice_depth(depth0 + at * depth_.steps[2]) - first_depth);
            out[n] = x | y << kPositionBits | depth << kDepthShift | std::uint64_t{one.density} << kDensityShift;
        }
        delivered_ += static_cast<std::size_t>(run);
        done += run;
    }
}

}  // namespace volsplat
