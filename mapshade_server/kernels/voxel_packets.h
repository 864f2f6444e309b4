// Preprocessing of a sub-cube: survey, histograms and voxel packets (paper: "Shading"; protocol/rules/index_rules.py).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/constants.h"
#include "paths/map_shade_kernels.h"
#include "source_volume.h"

namespace volsplat {

// The voxels of interest within a source that also holds their neighbours.
struct Interior {
    Index3 low;
    Index3 size;
};

// What is counted over even bins; voxels below go into the first one, above into the last.
struct Range {
    double low;
    double high;
};

// Blocks of the whole volume's grid, and where the interior begins in it (protocol/description/block_extremes.py).
struct Blocks {
    Index3 begin;
    Index3 size;   // voxels of a block
    Index3 count;  // blocks of the volume
};

struct Histograms {
    std::vector<std::int64_t> density;
    std::vector<std::int64_t> strength;
    std::vector<double> extremes;  // the least values of all blocks, then the greatest
};

// `matrix` (3x3, row-major) turns differences per index step into a gradient per unit of physical length.
RowExtremes survey(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix);

// Strength is the length of the gradient, or where there is a `second` scalar that: it holds the interior alone.
Histograms histograms(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix,
                      const SourceVolume* second, const Range& density, const Range& strength, const Blocks& blocks);

// Writes interior.size voxel packets, i fastest; strength as above.
void pack(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix,
          const SourceVolume* second, const QuantisationNumbers& numbers, std::uint32_t* packets);

}  // namespace volsplat
