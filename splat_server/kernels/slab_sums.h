// Plain structs of the planes of a frame of slabs that the loops of every instruction set share
// (protocol/rules/slab_shape.py).
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/compiler.h"
#include "kernels/packet_layout.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat {

// A sum of weights, above, and of weights times densities, below, in one number. Where voxels are smaller than half a
// pixel their weights are so small and so many that 32 bits would not do.
template <class Number>
struct SumLayout;

template <>
struct SumLayout<std::uint32_t> {
    typedef std::int16_t Weight;
    typedef std::int32_t Signed;  // which instruction sets convert
    typedef float Quotient;
    static constexpr int kDensityBits = 20;
    static constexpr double kUnit = 3000;  // of weights: what those around a point sum to
    // Of kernels with weights below 0, and what then makes sums positive: half of their room for weights, and a third
    // of that for densities
    static constexpr double kSignedUnit = 1200;
    static constexpr std::uint32_t kSignedBias = std::uint32_t{1} << 31 | 340000;
};

template <>
struct SumLayout<std::uint64_t> {
    typedef std::int32_t Weight;
    typedef std::int64_t Signed;
    typedef double Quotient;
    static constexpr int kDensityBits = 36;
    static constexpr double kUnit = 1 << 26;
    static constexpr double kSignedUnit = 1 << 26;
    static constexpr std::uint64_t kSignedBias = std::uint64_t{1} << 63 | std::uint64_t{3} << 33;
};

// Of what the weights around a point sum to: less is known only outside of the volume, and deep in no data.
constexpr double kLeastKnown = 1.0 / 16;

// The planes of a group of voxels are a block, which is shaded once it is complete. Those of the blocks that a group
// may reach lie next to each other for each pixel. So many are added to at once, from a multiple of others on.
constexpr int kBlockPlanes = kGroupPlanes;
constexpr int kPlanesAtOnce = 8, kPlaneStep = 4;

constexpr int kTileLines = 8, kTileColumns = 32;  // of what is noted to have been touched, and shaded at once
constexpr int kTilePixels = kTileLines * kTileColumns;

struct SlabTableView {
    const void* weights;             // [phase][fy][fx][row][column][slice]; more around may be read
    const RowSpan* spans;            // [phase][fy][row]: the columns that are reached at some offset
    const void* slice_bits;          // [slice]: all bits of a sum; zeros around
    const std::int32_t *left, *top;  // [fx], [fy]: of the box, from a voxel's pixel
    const std::int32_t* front;       // [phase]: likewise, from the plane below its depth
    std::uint64_t bias;              // what makes sums positive
    std::int32_t least;              // sums of weights below it are as good as none
    int before;                      // planes before that below its depth which a voxel may reach
    int offset_bits, slices, rows, columns;
};

// The sums of the blocks that a group of voxels may reach. Once a block is complete, its densities take their place.
struct SlabSums {
    void* sums;          // [line][column][plane, from the group's first on]
    std::int64_t pitch;  // columns from one line to the next
    int columns;
    int planes;             // whole blocks
    int margin;             // columns of a line before pixel 0
    int first_line, lines;  // of the image
    int tile_rows, tiles;
    int aside;           // pixels that gradients look to either side
    bool any_closed;     // tiles of the image
    std::uint64_t bias;  // see SlabTableView
    std::int32_t least;
};

struct SlabRuns {  // of one group
    const unsigned char* runs;
    const unsigned char* packets;
    std::uint64_t run_count;
};

struct SlabVoxel {
    std::int32_t left, top;     // of its box, in the sums
    std::uint32_t offset;       // of it: the number of its box in the table, if phases did not count
    std::uint8_t phase, plane;  // of its depth; that of the group's which its first slice lies on
    std::uint8_t density;
};

// Voxels are added by the patch of the sums where their boxes begin, so that what is written to stays in the fastest
// cache.
constexpr int kPatchBits = 4;  // the binary logarithm of columns and lines

// Those of a group that are left, patch by patch.
struct SlabVoxels {
    SlabVoxel* voxels;
    std::uint64_t count;
    std::uint32_t* patches;  // how many are in each
    int patch_columns;
};

// That in which a voxel's box begins.
VOLSPLAT_INLINE std::int64_t patch_of(std::int64_t left, std::int64_t top, std::int64_t patch_columns) {
    return (top < 0 ? 0 : top >> kPatchBits) * patch_columns + (left >> kPatchBits);
}

}  // namespace volsplat
