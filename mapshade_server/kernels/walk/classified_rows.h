// What the rows of a sub-cube show, kept from frame to frame: a frame then reads the visible voxels only.
//
// There are lists for each axis that samples can follow. A row's list is made when a frame walks it first, and holds
// as long as the same densities and strengths can be seen. Lists take a share of the voxel packets' memory at most;
// beyond it the axis that was not walked for the longest time is forgotten, and an axis that needs more than all of
// the share by itself is not kept. A walk may be outdated by another one that begins: its lists then may be kept no
// longer, and no longer grow. Any number of threads may walk: who claims a row makes its list, in room of their own,
// and who comes before it is there does without. Vector loops read beyond a list's end what another may
// be writing, and make nothing of it.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "kernels/large_memory.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "mapshade_server/kernels/source_volume.h"

namespace volsplat {

// For voxels of lists, of one walker alone.
struct ListRoom {
    std::size_t next = 0, end = 0;
};

// The lists along one axis.
class RowLists {
public:
    // For so many rows, with room for so many voxels.
    RowLists(std::size_t rows, std::size_t voxels);

    bool holds(std::size_t row) const { return (load(row) & kStates) == kListed; }
    bool empty(std::size_t row) const { return load(row) == kListed; }
    VisibleVoxels at(std::size_t row) const {
        const std::uint64_t listed = load(row), begin = listed >> kBeginShift;
        return {positions_.get() + begin, packets_.get() + begin, (listed & kCounts) >> kCountShift};
    }
    // Has a row that is walked soon, and where one that is walked later lies, brought from memory.
    void prefetch(std::size_t soon, std::size_t later) const;

    // Whether a row's list is still to be made, by whoever asks.
    bool claim(std::size_t row);

    // There must be room for them.
    void add(std::size_t row, const VisibleVoxels& voxels, ListRoom& room);

private:
    friend class ClassifiedRows;

    // Of a row its state, how many voxels it has, and where they begin.
    using Row = std::atomic<std::uint64_t>;
    static constexpr std::uint64_t kUnknown = 0, kClaimed = 1, kListed = 2, kStates = 3;
    static constexpr int kCountShift = 2, kBeginShift = 20;
    static constexpr std::uint64_t kCounts = (std::uint64_t{1} << kBeginShift) - (std::uint64_t{1} << kCountShift);
    static_assert(kLongestRow << kCountShift < std::int64_t{1} << kBeginShift);

    std::uint64_t load(std::size_t row) const { return rows_[row].load(std::memory_order_acquire); }

    // What follows is guarded by the lock of the classified rows that these lists are of.

    // What has been given out of the memory, and what would be with so many voxels more.
    std::size_t bytes() const { return bytes_with(0); }
    std::size_t bytes_with(std::size_t more_voxels) const;

    void enlarge(ListRoom& room, std::size_t more_voxels);

    // Forgets all rows, but keeps the memory that was touched.
    void clear();

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

    // Whether there is room for so many voxels in these lists along an axis; if not, or not any more, they are not
    // kept.
    bool make_room(int axis, RowLists& growing, std::size_t voxels, ListRoom& room);

    // What all lists take together, and the axes that have some.
    std::size_t bytes() const;
    std::vector<int> axes() const;

private:
    struct Axis {
        std::shared_ptr<RowLists> lists;
        std::uint64_t last_walk = 0;
        bool too_large = false;
    };

    bool may_grow(int axis, const RowLists& growing, std::size_t voxels);
    void forget_all_but(int axis);
    std::size_t bytes_locked() const;

    const Index3 size_;
    const std::size_t most_bytes_;
    mutable std::mutex mutex_;  // guards what follows
    Visibility visibility_{};
    std::array<Axis, 3> axes_;
    std::uint64_t walks_ = 0;
};

}  // namespace volsplat
