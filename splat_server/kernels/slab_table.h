// The slices of a voxel's kernel on the planes of a frame of slabs, for every fractional offset of a voxel
// (protocol/rules/slab_shape.py).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernel_projection.h"
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
    // Pixels of the box around a voxel.
    int width() const { return 2 * left_ + 2; }
    int height() const { return 2 * top_ + 2; }

private:
    template <class Number>
    std::vector<typename SumLayout<Number>::Weight> weights_of(const KernelProjection& kernel,
                                                               const Ellipsoid& ellipsoid);

    const int offset_bits_;
    const bool wide_;
    const int left_, top_, before_;
    std::vector<std::uint16_t> weights_;
    std::vector<std::uint32_t> wide_weights_;
    std::vector<SliceSpan> spans_;
};

}  // namespace volsplat
