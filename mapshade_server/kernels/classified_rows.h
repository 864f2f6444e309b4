// What the rows of a sub-cube show, kept from frame to frame: a frame then reads the visible voxels only.
//
// There are lists for each axis that samples can follow. A row's list is made when a frame walks it first, and holds
// as long as the same densities and strengths can be seen. Lists take a share of the voxel packets' memory at most;
// beyond it the axis that was not walked for the longest time is forgotten, and an axis that needs more than all of
// the share by itself is not kept. A walk may be outdated by another one that begins: its lists then may be kept no
// longer, and no longer grow. Walks must not use them at the same time.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/large_memory.h"
#include "paths/map_shade_kernels.h"
#include "source_volume.h"

namespace volsplat {

// The lists along one axis.
class RowLists {
public:
    // For so many rows, with room for so many voxels.
    RowLists(std::size_t rows, std::size_t voxels);

    bool holds(std::size_t row) const { return rows_[row].count != kUnknown; }
    VisibleVoxels at(std::size_t row) const {
        return {positions_.get() + rows_[row].begin, packets_.get() + rows_[row].begin, rows_[row].count};
    }
    // Has a row that is walked soon, and where one that is walked later lies, brought from memory.
    void prefetch(std::size_t soon, std::size_t later) const;

    // There must be room for them.
    void add(std::size_t row, const VisibleVoxels& voxels);

    // Forgets all rows, but keeps the memory that was touched.
    void clear();

    // What has been touched of the memory, and what would be with so many voxels more.
    std::size_t bytes() const { return bytes_with(0); }
    std::size_t bytes_with(std::size_t more_voxels) const;

private:
    static constexpr std::uint64_t kUnknown = (1 << 24) - 1;

    struct Row {
        std::uint64_t begin : 40;
        std::uint64_t count : 24;
    };

    std::vector<Row> rows_;
    LargeArray<std::uint32_t> packets_;
    LargeArray<std::uint16_t> positions_;
    std::size_t filled_ = 0, most_filled_ = 0;
};

class ClassifiedRows {
public:
    // The lists may take a share of what the voxel packets of a box take.
    ClassifiedRows(const Index3& size, double share);

    const Index3& size() const { return size_; }

    // The lists of the rows along an axis; null where they are not kept, or there is no memory for them. Lists of
    // another visibility are forgotten.
    std::shared_ptr<RowLists> rows_along(int axis, const Visibility& visibility);

    // Whether these lists along an axis may grow by so many voxels; if not, or not any more, they are not kept.
    bool make_room(int axis, const RowLists& growing, std::size_t voxels);

    // What all lists take together, and the axes that have some.
    std::size_t bytes() const;
    std::vector<int> axes() const;

private:
    struct Axis {
        std::shared_ptr<RowLists> lists;
        std::uint64_t last_walk = 0;
        bool too_large = false;
    };

    void forget_all_but(int axis);

    Index3 size_;
    std::size_t most_bytes_;
    Visibility visibility_{};
    std::array<Axis, 3> axes_;
    std::uint64_t walks_ = 0;
};

}  // namespace volsplat
