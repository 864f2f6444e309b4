// The slices of a voxel's kernel on the planes of a frame of slabs, for every fractional offset of a voxel
// (protocol/rules/slab_shape.py).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernel_projection.h"
#include "slab_samples.h"
#include "slab_sums.h"

namespace volsplat {

struct Ellipsoid {
    double amplitude;
    std::array<std::array<double, 3>, 3> form;  // rho^2 of pixels right, pixels down and planes behind
    std::array<double, 3> half_extents;         // of its bounding box
};

class SlabTable {
public:
    // 2^offset_bits offsets a pixel on each axis, and 2^kDepthBits a plane. `wide`: for sums of 64 bits. Throws
    // std::invalid_argument for numbers that make no table.
    SlabTable(const KernelProjection& kernel, const Ellipsoid& ellipsoid, int offset_bits, bool wide);

    SlabTableView view() const;
    bool wide() const { return wide_; }
    std::size_t sum_bytes() const { return wide_ ? sizeof(std::uint64_t) : sizeof(std::uint32_t); }
    // What the sums of all planes, and the densities of those that are kept, take of one pixel.
    std::size_t pixel_bytes() const { return planes() * sum_bytes() + kKeptPlanes * sizeof(float); }
    // From a group's first one on, that are added to with its voxels; whole blocks.
    int planes() const;
    // Pixels of the box around a voxel.
    int width() const { return columns_; }
    int height() const { return rows_; }

private:
    // Of sums of 32 or of 64 bits.
    template <class Number>
    struct Slices {
        std::vector<typename SumLayout<Number>::Weight> weights;
        std::vector<Number> bits;
    };

    template <class Number>
    Slices<Number> slices_of(const KernelProjection& kernel, const Ellipsoid& ellipsoid);
    template <class Number>
    double unit() const;
    template <class Number>
    SlabTableView view_of(const Slices<Number>& found) const;

    const int offset_bits_;
    const bool wide_, signed_;
    const int columns_, rows_, slices_;
    const std::vector<std::int32_t> left_, top_, front_;  // for each offset
    const int before_;                                    // planes before that below a voxel's depth which it may reach
    std::vector<RowSpan> spans_;
    Slices<std::uint32_t> narrow_slices_;
    Slices<std::uint64_t> wide_slices_;
};

}  // namespace volsplat
