// The voxels of a box that a frame of slabs needs: all that the density may depend on wherever something can be seen,
// kept from frame to frame in rows along one axis.
//
// A slab's densities lie between those of the voxels around it; with weights below 0, not far outside. So where the
// least and the greatest of these enclose no density that can be seen, nothing is seen, and whatever of them is left
// out changes nothing. That holds for any superset as well: towards a part of the grid that another box has, whatever
// may be needed is.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "kernels/large_memory.h"
#include "mapshade_server/kernels/source_volume.h"

namespace volsplat {

// All offsets that a box and a shape add up to, the same to either side along every axis.
struct Neighbourhood {
    Index3 box;                                    // voxels to either side
    std::vector<std::vector<std::int64_t>> shape;  // by offsets along k and j, from 0 on: how far along i

    Index3 reach() const;

    bool operator==(const Neighbourhood&) const = default;
};

// What decides which voxels are needed.
struct Need {
    std::array<std::uint64_t, 4> visible;  // a bit for each density
    Neighbourhood look;                    // what the densities of a slab with its middle in a voxel's cell depend on
    Neighbourhood spread;                  // and what is needed if these may show anything
    // By how much a density may leave those around, as a share of what lies between these: where all voxels around have
    // data, and where weights may sum to little
    double overshoot, edge_overshoot;
    std::array<bool, 3> before, behind;  // whether the grid goes on beyond the box

    bool operator==(const Need&) const = default;
};

// Of a voxel its position in the row and its density.
struct NeededVoxel {
    std::uint16_t position;
    std::uint8_t density;
};

// Rows along an axis, numbered by the other two, the lower one first.
class NeededRows {
public:
    NeededRows(const std::uint32_t* packets, const std::uint8_t* needed, const Index3& size, int axis);

    // The number of the row through a place in the box.
    std::size_t row_at(const Index3& place) const { return place[high_] * size_[low_] + place[low_]; }
    const NeededVoxel* begin(std::size_t row) const { return voxels_.get() + begins_[row]; }
    const NeededVoxel* end(std::size_t row) const { return voxels_.get() + begins_[row + 1]; }

private:
    const Index3 size_;
    const int low_, high_;  // the other two axes
    LargeArray<std::uint64_t> begins_;
    LargeArray<NeededVoxel> voxels_;
};

class NeededVoxels {
public:
    // Throws std::invalid_argument for a box whose rows positions cannot count.
    explicit NeededVoxels(const Index3& size);

    const Index3& size() const { return size_; }

    // Those of the axis that was asked for last are kept. Any thread may ask.
    std::shared_ptr<const NeededRows> rows_along(int axis, const Need& need, const std::uint32_t* packets);

private:
    const Index3 size_;
    std::mutex mutex_;  // guards what follows
    Need need_{};
    int axis_ = -1;
    std::shared_ptr<const NeededRows> rows_;
};

}  // namespace volsplat
