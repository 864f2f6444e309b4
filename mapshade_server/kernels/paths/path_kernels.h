// The hot loops that exist once for each instruction set, and the numbers they take. All sets give the same bits.
//
// Files in this folder are compiled with AVX2 or AVX-512 switched on. They include no standard header that holds
// inline functions: the linker would keep one copy of such a function, and it might be the one this machine's CPU
// cannot run.
#pragma once

#include <cstddef>
#include <cstdint>

namespace volsplat {

// Vector loops read and write whole vectors: arrays given to them have this many spare elements at their end.
constexpr std::size_t kSpare = 32;

// Voxels that share a cache line: lines of packets are transposed this many grid columns (i) at a time.
constexpr int kStripLanes = 16;

// The rows of source values around one row: NaN stands for a neighbour that is missing.
struct SourceRows {
  const double* centre;  // [-1] and [n] are the neighbours along i
  const double* j_before;
  const double* j_after;
  const double* k_before;
  const double* k_after;
};

// Gradients of one row, per unit of physical length, and their lengths (0 where there is none).
struct GradientRow {
  double* x;
  double* y;
  double* z;
  double* length;
};

struct QuantisationNumbers {
  double window_low;
  double density_scale;
  double strength_scale;
  bool octahedral;
};

// Least and greatest of what a survey looks at, joined over rows.
struct RowExtremes {
  double low;
  double high;
  double max_gradient;
  std::int64_t no_data;
};

// Survivors of a row, in rising order of position, and what colours and places them.
struct SurvivingSamples {
  const std::uint32_t* positions;  // sample numbers within the row
  const std::uint32_t* packets;
  const std::uint16_t* opacity;  // 12-bit codes
  const std::uint8_t* emit_index;
  const std::uint8_t* refl_index;
};

struct ColourTables {
  const float* emit;   // 256 x (r, g, b, 0)
  const float* refl;   // likewise
  const float* light;  // for each direction code
};

// Screen positions of a row's samples: value(n) = start + n * step, 2^-32 pixel.
struct RowLine {
  std::int64_t start_x, start_y;
  std::int64_t step_x, step_y;
};

struct PathKernels {
  // Copies the packets whose bit in `visible` (indexed by density | strength << 8) is set and that hold data, with
  // their positions; returns how many. Both outputs need n + kSpare elements.
  std::size_t (*compact)(const std::uint32_t* row, std::size_t n, const std::uint32_t* visible,
                         std::uint32_t* positions, std::uint32_t* packets);

  // lanes[l][n] = source[n * stride + l] for l < kStripLanes; lanes are `pitch` apart.
  void (*transpose)(const std::uint32_t* source, std::ptrdiff_t stride, std::size_t n, std::uint32_t* lanes,
                    std::size_t pitch);

  // Writes shaded packets of `count` survivors: the first..first+count-1 in order, or first downwards.
  void (*shade)(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line,
                std::int32_t origin_x, std::int32_t origin_y, std::size_t first, std::size_t count, bool descending,
                std::uint64_t* out);

  // Differences by two steps, one-sided next to missing neighbours, turned physical by the row-major 3x3 `matrix`.
  void (*gradient)(const SourceRows& rows, std::size_t n, const double* matrix, const GradientRow& out);

  void (*survey)(const double* values, const double* length, std::size_t n, RowExtremes* extremes);

  void (*pack)(const double* values, const GradientRow& gradient, std::size_t n, const QuantisationNumbers& numbers,
               std::uint32_t* packets);
};

}  // namespace volsplat
