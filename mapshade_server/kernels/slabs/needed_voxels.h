// Which voxels of a box a frame of slabs needs: all that the density may depend on wherever something can be seen.
//
// A slab's densities lie between those of the voxels around it; with weights below 0, not far outside of those that are
// so near as to have weights above 0. So where the
// least and the greatest of these enclose no density that can be seen, nothing is seen, and whatever of them is left
// out changes nothing. That holds for any superset as well: towards a part of the grid that another box has, whatever
// may be needed is.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

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
    Neighbourhood inner;                   // of these, all that may have weights above 0
    Neighbourhood spread;                  // and what is needed if these may show anything
    // By how much a density may leave the inner ones, as a share of how far those around lie on their other side: where
    // all voxels around have data, and where weights may sum to little
    double overshoot, edge_overshoot;
    std::array<bool, 3> before, behind;  // whether the grid goes on beyond the box

    // How far away a voxel may decide on whether another one is needed.
    Index3 reach() const;

    bool operator==(const Need&) const = default;
};

struct Part {  // of a box
    Index3 low, size;
};

typedef std::vector<std::uint8_t> Bytes;

// 1 for each voxel of a part that is needed, as far as the part tells: right at that distance from where it was cut.
Bytes needed_marks(const std::uint32_t* packets, const Index3& size, const Part& part, const Need& need);

}  // namespace volsplat
