// Preprocessing of a sub-cube: survey, histograms and voxel packets (paper: "Shading"; protocol/index_rules.py).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "paths/path_kernels.h"
#include "source_volume.h"

namespace volsplat {

constexpr int kHistogramBins = 65536;

// The voxels of interest within a source that also holds their neighbours.
struct Interior {
  Index3 low;
  Index3 size;
};

struct Histograms {
  std::vector<std::int64_t> density;   // over low..high
  std::vector<std::int64_t> gradient;  // over 0..max_gradient
};

// `matrix` (3x3, row-major) turns differences per index step into a gradient per unit of physical length.
RowExtremes survey(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix);

Histograms histograms(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix,
                      double low, double high, double max_gradient);

// Writes interior.size voxel packets, i fastest.
void pack(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix,
          const QuantisationNumbers& numbers, std::uint32_t* packets);

}  // namespace volsplat
