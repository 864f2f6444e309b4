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

    const std::uint32_t* rows;
    const std::int64_t* ends;  // of each column, among the rows
    std::size_t columns;
    int axis;        // along which they run; kNoAxis along a diagonal, where all voxels of a row are one layer
    bool from_high;  // whether the viewer is at their upper end
    int layers;      // that a voxel stands for unless it reaches beyond the volume, and voxels of each
    int places;
};

constexpr int kLightSteps = 4;  // see level_light

// What an entry of a table over density | strength << 8 says of a voxel: the optical depth of a layer of such voxels,
// how much light that lets through, what they emit, and what they reflect of each step of the light.
struct VoxelLook {
    double depth, through, emitted, reflected[kLightSteps];
};
constexpr int kLookNumbers = 3 + kLightSteps;
static_assert(sizeof(VoxelLook) == kLookNumbers * sizeof(double));

struct SeenLight {
    double emitted = 0.0;
    std::vector<std::int64_t> codes;  // the directions of which something is reflected
    std::vector<double> reflected;    // kLightSteps of each
};

struct SeenOfLevels {
    SeenLight finer, coarser;
};

// The finer light is that of layers, whose places are seen as one, and along axes partly that of columns of single
// voxels: footprints blur a level's means less far beyond their rims than layers alone would say.
// Sums are taken in one order.
SeenOfLevels seen_in_columns(const ColumnView& columns, const VoxelLook* finer, const VoxelLook* coarser);

// What voxels reflect of each step of the light, so large a step, if they reflect so much of it in each channel and
// have so much room there: the mean of the channels, kLightSteps of each of n voxels; see level_light.
std::vector<double> reflected_in_steps(const double* refl, const double* room, std::size_t n, int channels,
                                       double step);

}  // namespace volsplat
