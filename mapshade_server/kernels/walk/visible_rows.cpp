// Classifies rows in place where they are contiguous, and strips of columns where they are not.
#include "visible_rows.h"

#include <algorithm>

#include "mapshade_server/kernels/paths/map_shade_kernels.h"

namespace volsplat {

namespace {

// How many rows ahead lists are brought from memory: rows that follow each other may lie far apart there.
constexpr std::ptrdiff_t kRowsSoon = 8;
constexpr std::ptrdiff_t kRowsLater = 16;

VisibleVoxels clipped(const VisibleVoxels& voxels, std::int64_t begin, std::int64_t end) {
    const std::uint16_t* first = voxels.positions;
    const std::uint16_t* last = first + voxels.count;
    if (first == last || (*first >= begin && last[-1] < end)) return voxels;
    const std::uint16_t* from = std::lower_bound(first, last, begin);
    const std::uint16_t* to = std::lower_bound(from, last, end);
    return {from, voxels.packets + (from - first), static_cast<std::size_t>(to - from)};
}

}  // namespace

Ordinals visited_of(const PacketBox& box, const WalkPlan& plan, int level) {
    const int axis = plan.axes[level];
    const AxisVisits& visits = plan.visits[axis];
    return {visits.ordinal_from(box.low[axis]), visits.ordinal_from(box.low[axis] + box.size[axis])};
}

VisibleRows::VisibleRows(const PacketBox& box, const WalkPlan& plan, const Visibility& visibility, std::int64_t spread)
    : box_(box), plan_(plan), visibility_(visibility) {
    const std::int64_t by_axis[3] = {1, box.size[0], box.size[0] * box.size[1]};
    for (int level = 0; level < 3; ++level) {
        const int axis = plan.axes[level];
        ordinals_[level] = visited_of(box, plan, level);
        strides_[level] = by_axis[axis];
    }
    const int inner = std::min(plan.axes[0], plan.axes[1]);
    for (int level = 0; level < 2; ++level) list_strides_[level] = plan.axes[level] == inner ? 1 : box.size[inner];
    soon_ = kRowsSoon * spread * next_list();
    later_ = kRowsLater * spread * next_list();
    if (plan.visits_of(2).stride == 1 && !empty()) lists_ = box.classified->rows_along(plan.axes[2], visibility);
}

bool VisibleRows::empty() const {
    return ordinals_[0].count() <= 0 || ordinals_[1].count() <= 0 || ordinals_[2].count() <= 0;
}

Ordinals VisibleRows::piece_of(std::int64_t ordinal) const {
    const std::int64_t begin = ordinal - (ordinal - ordinals_[2].begin) % kLongestRow;
    return {begin, std::min(begin + kLongestRow, ordinals_[2].end)};
}

void VisibleRows::prefetch_after(std::int64_t sheet_ordinal, std::int64_t row_ordinal) const {
    if (!lists_) return;
    const std::size_t number = list_number(local(0, sheet_ordinal), local(1, row_ordinal));
    lists_->prefetch(number + soon_, number + later_);
}

std::int64_t VisibleRows::known_empty(std::int64_t sheet_ordinal, std::int64_t row_ordinal, std::int64_t most) const {
    if (!lists_) return 0;
    std::size_t number = list_number(local(0, sheet_ordinal), local(1, row_ordinal));
    std::int64_t rows = 0;
    for (; rows < most && lists_->empty(number); ++rows) {
        lists_->prefetch(number + soon_, number + later_);
        number += next_list();
    }
    return rows;
}

VisibleRow VisibleRows::row(std::int64_t sheet_ordinal, std::int64_t row_ordinal, const Ordinals& samples) {
    const std::int64_t sheet = local(0, sheet_ordinal), row = local(1, row_ordinal);
    if (lists_) {
        const std::size_t number = list_number(sheet, row);
        if (lists_->holds(number) || classify_into_lists(sheet, row)) {
            const std::int64_t origin = samples.begin - local(2, samples.begin);
            return {clipped(lists_->at(number), samples.begin - origin, samples.end - origin), origin};
        }
    }
    const Ordinals piece = piece_of(samples.begin);
    const VisibleVoxels voxels = plan_.axes[2] == 0 ? contiguous_row(sheet, row, samples)
                                                    : strip_row(sheet, row, row_ordinal - ordinals_[1].begin, piece);
    return {clipped(voxels, samples.begin - piece.begin, samples.end - piece.begin), piece.begin};
}

std::int64_t VisibleRows::local(int level, std::int64_t ordinal) const {
    const int axis = plan_.axes[level];
    return plan_.visits[axis].index(ordinal) - box_.low[axis];
}

std::size_t VisibleRows::list_number(std::int64_t sheet, std::int64_t row) const {
    return static_cast<std::size_t>(sheet * list_strides_[0] + row * list_strides_[1]);
}

std::ptrdiff_t VisibleRows::next_list() const {
    const std::int64_t apart = plan_.visits_of(1).stride * list_strides_[1];
    return plan_.ascending[1] ? apart : -apart;
}

// Classifies the whole row, and those that share its cache lines, visited or not: lists outlive frames. False where
// another walker is at them, or the lists are not kept after all.
bool VisibleRows::classify_into_lists(std::int64_t sheet, std::int64_t row) {
    const int axis = plan_.axes[2];
    const Samples samples{0, 1, box_.size[axis]};
    const std::int64_t column = sheets_along_i() ? sheet : row;
    const Columns columns = axis == 0 ? Columns{column, column, column + 1} : columns_at(column);
    std::size_t number = list_number(sheet, row) - static_cast<std::size_t>(column - columns.begin);
    if (!lists_->claim(number)) return false;
    if (axis == 0) {
        make_lanes(1, samples.count);
        counts_[0] = static_cast<std::uint32_t>(map_shade_kernels().classify_row(
            box_.packets + sheet * strides_[0] + row * strides_[1], static_cast<std::size_t>(samples.count), 0,
            visibility_, positions_.data(), packets_.data()));
    } else {
        classify_columns(sheets_along_i() ? row : sheet, columns, samples, lanes_of(columns, 1));
    }

    std::size_t found = 0;
    for (std::int64_t c = columns.begin; c < columns.end; ++c) found += counts_[c - columns.first];
    if (!box_.classified->make_room(axis, *lists_, found, room_)) {
        lists_.reset();
        return false;
    }
    for (std::int64_t c = columns.begin; c < columns.end; ++c, ++number) {
        lists_->add(number, lane(c - columns.first), room_);
    }
    return true;
}

VisibleVoxels VisibleRows::contiguous_row(std::int64_t sheet, std::int64_t row, const Ordinals& samples) {
    const std::size_t n = static_cast<std::size_t>(samples.count());
    const std::uint32_t* packets = box_.packets + sheet * strides_[0] + row * strides_[1] + local(2, samples.begin);
    make_lanes(1, piece_of(samples.begin).count());
    const std::int64_t stride = plan_.visits_of(2).stride;
    if (stride != 1) {
        picked_.resize(pitch_);
        for (std::size_t at = 0; at < n; ++at) picked_[at] = packets[static_cast<std::int64_t>(at) * stride];
        packets = picked_.data();
    }
    const std::size_t first = static_cast<std::size_t>(samples.begin - piece_of(samples.begin).begin);
    counts_[0] = static_cast<std::uint32_t>(
        map_shade_kernels().classify_row(packets, n, first, visibility_, positions_.data(), packets_.data()));
    return lane(0);
}

VisibleVoxels VisibleRows::strip_row(std::int64_t sheet, std::int64_t row, std::int64_t row_number,
                                     const Ordinals& piece) {
    // Where sheets follow i, every row keeps its strip for the next sheets; else one strip serves the next rows
    const std::int64_t column = sheets_along_i() ? sheet : row, other = sheets_along_i() ? row : sheet;
    const Columns columns = columns_at(column);
    const std::int64_t pieces = (ordinals_[2].count() + kLongestRow - 1) / kLongestRow;
    const std::int64_t piece_number = (piece.begin - ordinals_[2].begin) / kLongestRow;
    const std::int64_t tag = (other * box_.size[0] + columns.begin) * pieces + piece_number;

    if (strips_.empty()) strips_.resize(sheets_along_i() ? ordinals_[1].count() * pieces : 1);
    Strip& strip = strips_[sheets_along_i() ? row_number * pieces + piece_number : 0];
    if (strip.tag != tag) {
        classify_columns(other, columns, {local(2, piece.begin), plan_.visits_of(2).stride, piece.count()},
                         lanes_of(columns, plan_.visits[0].stride));
        store(strip);
        strip.tag = tag;
    }
    const std::int64_t number = column - columns.first;
    const std::uint32_t begin = strip.begins[number];
    return {strip.positions.data() + begin, strip.packets.data() + begin, strip.begins[number + 1] - begin};
}

VisibleRows::Columns VisibleRows::columns_at(std::int64_t column) const {
    const std::int64_t size = box_.size[0], begin = column / kStripLanes * kStripLanes;
    return {std::max<std::int64_t>(0, std::min(begin, size - kStripLanes)), begin, std::min(begin + kStripLanes, size)};
}

// A bit for each column that is visited if every so many along i are.
std::uint64_t VisibleRows::lanes_of(const Columns& columns, std::int64_t stride) const {
    std::uint64_t lanes = 0;
    for (std::int64_t column = columns.begin; column < columns.end; ++column) {
        const bool visited = (column + box_.low[0] - plan_.visits[0].first) % stride == 0;
        lanes |= static_cast<std::uint64_t>(visited) << (column - columns.first);
    }
    return lanes;
}

// Classifies those columns whose bit is `wanted`; their other coordinate is that of a sheet or a row.
void VisibleRows::classify_columns(std::int64_t other, const Columns& columns, const Samples& samples,
                                   std::uint64_t wanted) {
    make_lanes(kStripLanes, samples.count);
    const std::int64_t other_stride = strides_[sheets_along_i() ? 1 : 0];
    const std::uint32_t* source = box_.packets + columns.first + other * other_stride + samples.first * strides_[2];
    map_shade_kernels().classify_columns(source, strides_[2] * samples.step, static_cast<std::size_t>(samples.count),
                                         wanted, visibility_, {positions_.data(), packets_.data(), pitch_},
                                         counts_.data());
}

void VisibleRows::make_lanes(std::size_t lanes, std::int64_t longest) {
    pitch_ = static_cast<std::size_t>(longest) + kSpare;
    if (positions_.size() >= lanes * pitch_) return;
    positions_.resize(lanes * pitch_);
    packets_.resize(lanes * pitch_);
}

VisibleVoxels VisibleRows::lane(std::int64_t number) const {
    const std::size_t begin = static_cast<std::size_t>(number) * pitch_;
    return {positions_.data() + begin, packets_.data() + begin, counts_[number]};
}

void VisibleRows::store(Strip& strip) const {
    std::uint32_t all = 0;
    for (int number = 0; number < kStripLanes; ++number) {
        strip.begins[number] = all;
        all += counts_[number];
    }
    strip.begins[kStripLanes] = all;
    strip.positions.resize(all + kSpare);
    strip.packets.resize(all + kSpare);
    for (int number = 0; number < kStripLanes; ++number) {
        const VisibleVoxels voxels = lane(number);
        std::copy_n(voxels.positions, voxels.count, strip.positions.data() + strip.begins[number]);
        std::copy_n(voxels.packets, voxels.count, strip.packets.data() + strip.begins[number]);
    }
}

}  // namespace volsplat
