// Plain structs of the planes of a frame of slabs that the splat loops of every instruction set share
// (protocol/rules/slab_shape.py).
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/packet_layout.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat {

// A sum of weights, above, and of weights times densities, below, in one number. Where voxels are smaller than half a
// pixel their weights are so small and so many that 32 bits would not do.
template <class Number>
struct SumLayout;

template <>
struct SumLayout<std::uint32_t> {
    typedef std::uint16_t Weight;
    typedef float Quotient;
    static constexpr int kDensityBits = 20;
    static constexpr double kUnit = 3000;  // of weights: what those around a point sum to
};

template <>
struct SumLayout<std::uint64_t> {
    typedef std::uint32_t Weight;
    typedef double Quotient;
    static constexpr int kDensityBits = 36;
    static constexpr double kUnit = 1 << 26;
};

constexpr int kSliceLanes = 8;  // of a row of a slice that are added at once

constexpr int kTileLines = 8, kTileColumns = 32;  // of what is noted to have been touched

// What a slice of the kernel may reach: rows, and whole vectors of a row.
struct SliceSpan {
    std::int32_t row_begin, row_end, column_begin, column_end;
};

struct SlabTableView {
    const void* weights;     // [phase][fy][fx][slice][row][pitch]
    const SliceSpan* spans;  // [phase][slice]
    int offset_bits, slices, rows, columns, pitch;
    int left, top;  // the box begins so many pixels before that of a sample
    int before;     // slices before the plane below a sample
};

// A ring of planes: as many as a group of voxels may reach, and those that are not drawn yet.
struct SlabSums {
    void* sums;
    std::int64_t plane, pitch;  // numbers from one plane to the next, and from one line to the next
    int margin;                 // numbers of a line before pixel 0
    int first_line, lines;      // of the image
    int ring;                   // planes
    int planes;                 // of the frame
    std::uint8_t* touched;      // [ring][tile row][tile]
    int tile_rows, tiles;
    int aside;        // pixels that gradients look to either side
    bool any_closed;  // tiles of the image
};

// Runs of one group, of which `first_plane` is the one below a voxel at depth 0 of the group.
struct SlabRuns {
    const unsigned char* runs;
    const unsigned char* packets;
    std::uint64_t run_count;
    std::int64_t first_plane;
};

}  // namespace volsplat
