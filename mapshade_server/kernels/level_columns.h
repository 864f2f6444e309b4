// What a ray sees of columns of a coarser level's voxels, and what it sees of those that they stand for.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace volsplat {

// Rows of a packet of the coarser level and the eight that it stands for, i fastest; kBeyond where there is none:
// beyond the volume, and second ones along an axis that is not halved.
struct ColumnView {
    static constexpr int kRow = 9;
    static constexpr std::uint32_t kBeyond = 0xFFFFFFFFu;
    static constexpr int kNoAxis = -1;
    static constexpr int kBundle = 4;

    const std::uint32_t* rows;
    const std::int64_t* ends;  // of each column or bundle, among the rows
    std::size_t columns;
    int axis;            // along which bundles of four run, four rows to a layer; kNoAxis along a diagonal
    bool from_high;      // whether the viewer is at their upper end
    bool high_first[2];  // whether of those abreast the upper ones are nearer, on the two axes across, the lower first
    int factors[3];      // how many voxels one stands for on each axis, 1 or 2, unless it reaches beyond the volume

    bool along_axis() const { return axis != kNoAxis; }
    int children() const { return factors[0] * factors[1] * factors[2]; }
};

constexpr int kLightSteps = 4;  // see level_light

// What an entry of a table over density | strength << 8 says of a voxel: the optical depth of a layer of such voxels,
// what they emit, and what they reflect of each step of the light.
struct VoxelLook {
    double depth, emitted, reflected[kLightSteps];
};
constexpr int kLookNumbers = 2 + kLightSteps;
static_assert(sizeof(VoxelLook) == kLookNumbers * sizeof(double));

struct SeenLight {
    double emitted = 0.0;
    std::vector<std::int64_t> codes;  // the directions of which something is reflected
    std::vector<double> reflected;    // kLightSteps of each
};

struct SeenOfLevels {
    SeenLight finer, coarser;
};

// Along a diagonal a row is one layer of either level. Along an axis a bundle is what a footprint of a pixel mixes of a
// sheet before the next one is seen through it: the four voxels abreast, and of the finer level those of each of their
// layers, one after the other as a sheet's samples are combined.
// Sums are taken in one order.
SeenOfLevels seen_in_columns(const ColumnView& columns, const VoxelLook* finer, const VoxelLook* coarser);

// What voxels reflect of each step of the light, so large a step, if they reflect so much of it in each channel and
// have so much room there: the mean of the channels, kLightSteps of each of n voxels; see level_light.
std::vector<double> reflected_in_steps(const double* refl, const double* room, std::size_t n, int channels,
                                       double step);

}  // namespace volsplat
