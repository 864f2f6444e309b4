// The voxels that can be seen in rows of a box along any grid axis: read from the lists that are kept of them, or
// found in the voxel packets.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "classified_rows.h"
#include "walk_plan.h"

namespace volsplat {

struct PacketBox {
    const std::uint32_t* packets;  // i fastest; kSpare more can be read
    Index3 low;                    // its place in the grid
    Index3 size;
    std::shared_ptr<ClassifiedRows> classified;
};

// A half-open range of visit ordinals.
struct Ordinals {
    std::int64_t begin, end;
    std::int64_t count() const { return end - begin; }
    bool holds(std::int64_t ordinal) const { return ordinal >= begin && ordinal < end; }
};

// What a box has of the axis of sheets (0), rows (1) or samples (2).
Ordinals visited_of(const PacketBox& box, const WalkPlan& plan, int level);

struct VisibleRow {
    VisibleVoxels voxels;
    std::int64_t origin;  // the ordinal of the sample at position 0
};

class VisibleRows {
public:
    // Of rows that come soon it is asked for those so many times as far away: see Turns::spread.
    VisibleRows(const PacketBox& box, const WalkPlan& plan, const Visibility& visibility, std::int64_t spread);

    const Ordinals& ordinals(int level) const { return ordinals_[level]; }
    bool empty() const;

    // Rows are walked in pieces that positions can count: the piece that holds a sample.
    Ordinals piece_of(std::int64_t ordinal) const;

    // Has the rows that come next on the sheet brought from memory.
    void prefetch_after(std::int64_t sheet_ordinal, std::int64_t row_ordinal) const;

    // How many rows from this one on in traversal order, `most` at most, are known to show nothing at all.
    std::int64_t known_empty(std::int64_t sheet_ordinal, std::int64_t row_ordinal, std::int64_t most) const;

    // What can be seen of some samples of one piece of a row; valid until the next call.
    VisibleRow row(std::int64_t sheet_ordinal, std::int64_t row_ordinal, const Ordinals& samples);

private:
    // The visible voxels of rows next to each other along i. Which ones is told by the tag.
    struct Strip {
        std::int64_t tag = -1;
        std::vector<std::uint16_t> positions;
        std::vector<std::uint32_t> packets;
        std::array<std::uint32_t, kStripLanes + 1> begins;
    };

    // Columns of the box that are classified together; `first` is that of lane 0.
    struct Columns {
        std::int64_t first, begin, end;
    };

    // Samples of the box: the first, the way from one to the next, and how many.
    struct Samples {
        std::int64_t first, step, count;
    };

    bool sheets_along_i() const { return plan_.axes[0] == 0; }
    std::int64_t local(int level, std::int64_t ordinal) const;
    std::size_t list_number(std::int64_t sheet, std::int64_t row) const;
    std::ptrdiff_t next_list() const;  // from a row's to that of the next one in traversal order
    bool classify_into_lists(std::int64_t sheet, std::int64_t row);
    VisibleVoxels contiguous_row(std::int64_t sheet, std::int64_t row, const Ordinals& samples);
    VisibleVoxels strip_row(std::int64_t sheet, std::int64_t row, std::int64_t row_number, const Ordinals& piece);
    Columns columns_at(std::int64_t column) const;
    std::uint64_t lanes_of(const Columns& columns, std::int64_t stride) const;
    void classify_columns(std::int64_t other, const Columns& columns, const Samples& samples, std::uint64_t wanted);
    void make_lanes(std::size_t lanes, std::int64_t longest);
    VisibleVoxels lane(std::int64_t number) const;
    void store(Strip& strip) const;

    PacketBox box_;
    const WalkPlan& plan_;
    Visibility visibility_;
    Ordinals ordinals_[3];
    std::int64_t strides_[3];       // in packets, by level
    std::int64_t list_strides_[2];  // in list numbers, of sheets and rows
    std::shared_ptr<RowLists> lists_;
    std::ptrdiff_t soon_ = 0, later_ = 0;  // how far it is to lists that are to be brought from memory
    ListRoom room_;

    // Where rows are classified
    std::size_t pitch_ = 0;
    std::vector<std::uint16_t> positions_;
    std::vector<std::uint32_t> packets_;
    std::array<std::uint32_t, kStripLanes> counts_;
    std::vector<std::uint32_t> picked_;  // visited samples of a contiguous row
    std::vector<Strip> strips_;
};

}  // namespace volsplat
