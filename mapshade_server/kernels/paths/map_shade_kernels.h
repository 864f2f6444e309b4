// The hot loops that exist once for each instruction set, and the numbers they take. All sets give the same bits.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/path_table.h"

namespace volsplat {

// Vector loops read and write whole vectors: arrays given to them have this many spare elements at their end.
constexpr std::size_t kSpare = 64;

// Grid columns (i) whose rows along j or k are classified together: lines of packets are read four cache lines wide.
constexpr int kStripLanes = 64;
static_assert(kSpare >= kStripLanes && kSpare >= 16, "the widest vectors hold 16 numbers");

// The longest row that positions of 16 bits can count.
constexpr std::int64_t kLongestRow = 65536;

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
    double strength_low;
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

// A voxel can be seen where the bits of its density and of its strength are both set and it has data.
struct Visibility {
    std::uint32_t density[8];
    std::uint32_t strength[8];
};

// Voxels of a row that can be seen, in rising order of position: the number of their sample within the row.
struct VisibleVoxels {
    const std::uint16_t* positions;
    const std::uint32_t* packets;
    std::size_t count;
};

// Where the visible voxels of several rows are written: `pitch` apart.
struct VoxelLanes {
    std::uint16_t* positions;
    std::uint32_t* packets;
    std::size_t pitch;
};

// The bytes that index a table, one for each survivor: `spacing` bytes apart.
struct TableIndices {
    const std::uint8_t* bytes;
    std::size_t spacing;
};

// Visible voxels with what colours them.
struct SurvivingSamples {
    VisibleVoxels voxels;
    const std::uint16_t* opacity;  // 12-bit codes
    TableIndices emit;
    TableIndices refl;
};

struct ColourTables {
    const float* emit;   // 256 x (r, g, b, 0), or of a plane 65536 at density | strength << 8
    const float* refl;   // likewise
    const float* light;  // for each direction code
    bool plane;
};

// Screen positions of a row's samples: value(n) = start + n * step, 2^-32 pixel.
struct RowLine {
    std::int64_t start_x, start_y;
    std::int64_t step_x, step_y;
};

// Of an image: bit x of row y tells that a sample is hidden if its reach begins at pixel (x, y).
struct HiddenMap {
    const std::uint32_t* words;
    std::int32_t words_in_row;
    std::int32_t last_column, last_row;
};

// Survivors first..first+count-1 that go into one row run, whose origin is in 1/64 pixel.
struct RunSamples {
    std::size_t first, count;
    std::int32_t origin_x, origin_y;
    bool descending;  // written last to first
};

// Unit vectors, zeros where there is no direction.
struct DirectionVectors {
    const double* x;
    const double* y;
    const double* z;
};

struct Lighting {
    double light[3];  // unit vector towards the light, physical axes
    double half[3];   // between light and eye, or zero where they are opposite
    bool diffuse, specular, two_sided;
    double specular_power;
};

// The kernels of one instruction set.
struct MapShadeKernels {
    // Writes the visible ones of n packets, the first of which has the position `first`; returns how many. Both
    // outputs need n + kSpare elements.
    Kernel<std::size_t(const std::uint32_t* row, std::size_t n, std::size_t first, const Visibility& visibility,
                       std::uint16_t* positions, std::uint32_t* packets)>
        classify_row;

    // The rows l < kStripLanes made of source[n * stride + l], as far as their bit in `wanted` is set.
    Kernel<void(const std::uint32_t* source, std::ptrdiff_t stride, std::size_t n, std::uint64_t wanted,
                const Visibility& visibility, const VoxelLanes& lanes, std::uint32_t* counts)>
        classify_columns;

    // Writes the voxels that are not hidden; returns how many. `line`, rounded down, is the first pixel that each of
    // them reaches. Both outputs need voxels.count + kSpare elements.
    Kernel<std::size_t(const VisibleVoxels& voxels, const HiddenMap& map, const RowLine& line, std::uint16_t* positions,
                       std::uint32_t* packets)>
        leave_out_hidden;

    // Opacity codes at density | strength << 8; tells whether none of them is 0. The table has spare elements.
    Kernel<bool(const std::uint32_t* packets, std::size_t n, const std::uint16_t* table, std::uint16_t* codes)>
        opacity_by_packet;

    // Opacity codes at opac | modu << 8; tells whether none of them is 0.
    Kernel<bool(const TableIndices& opac, const TableIndices& modu, std::size_t n, const std::uint16_t* table,
                std::uint16_t* codes)>
        opacity_by_indices;

    // Bytes of direction codes.
    Kernel<void(const std::uint32_t* packets, std::size_t n, const std::uint8_t* table, std::uint8_t* bytes)>
        direction_bytes;

    // (start + position * step) >> 32, clamped to 0..255; no value is beyond 2^52.
    Kernel<void(const std::uint16_t* positions, std::size_t n, std::int64_t start, std::int64_t step,
                std::uint8_t* bytes)>
        screen_bytes;

    // table[position * step].
    Kernel<void(const std::uint16_t* positions, std::size_t n, const std::uint8_t* table, std::int64_t step,
                std::uint8_t* bytes)>
        grid_bytes;

    // Writes a run's shaded packets.
    Kernel<void(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, const RunSamples& run,
                std::uint64_t* out)>
        shade;

    // base^exponent for a base of 0 to 1, the same bits on every machine.
    Kernel<double(double base, double exponent)> power;

    // What multiplies the reflected colour if the gradient goes along each axis, and if it goes the opposite way.
    Kernel<void(const DirectionVectors& axes, std::size_t n, const Lighting& lighting, float* ahead, float* behind)>
        light;

    // 12-bit codes of 1 - (1 - thin)^exponent.
    Kernel<void(const double* thin, std::size_t n, double exponent, std::uint16_t* codes)> opacity_codes;

    // Differences by two steps, one-sided next to missing neighbours, turned physical by the row-major 3x3 `matrix`.
    Kernel<void(const SourceRows& rows, std::size_t n, const double* matrix, const GradientRow& out)> gradient;

    Kernel<void(const double* values, const double* length, std::size_t n, RowExtremes* extremes)> survey;

    // `strengths` are the gradient's lengths or a second scalar.
    Kernel<void(const double* values, const double* strengths, const GradientRow& gradient, std::size_t n,
                const QuantisationNumbers& numbers, std::uint32_t* packets)>
        pack;

    // Each becomes the lesser of itself and its counterpart elsewhere.
    Kernel<void(const std::uint8_t* other, std::size_t n, std::uint8_t* bytes)> least;

    Kernel<void(const std::uint8_t* other, std::size_t n, std::uint8_t* bytes)> greatest;
};

// Those of the CPU path in use.
const MapShadeKernels& map_shade_kernels();

}  // namespace volsplat

#if defined(VOLSPLAT_PATH)
namespace volsplat::VOLSPLAT_PATH {

FunctionOf<&MapShadeKernels::classify_row> classify_row;
FunctionOf<&MapShadeKernels::classify_columns> classify_columns;
FunctionOf<&MapShadeKernels::leave_out_hidden> leave_out_hidden;
FunctionOf<&MapShadeKernels::opacity_by_packet> opacity_by_packet;
FunctionOf<&MapShadeKernels::opacity_by_indices> opacity_by_indices;
FunctionOf<&MapShadeKernels::direction_bytes> direction_bytes;
FunctionOf<&MapShadeKernels::screen_bytes> screen_bytes;
FunctionOf<&MapShadeKernels::grid_bytes> grid_bytes;
FunctionOf<&MapShadeKernels::shade> shade;
FunctionOf<&MapShadeKernels::power> power;
FunctionOf<&MapShadeKernels::light> light;
FunctionOf<&MapShadeKernels::opacity_codes> opacity_codes;
FunctionOf<&MapShadeKernels::gradient> gradient;
FunctionOf<&MapShadeKernels::survey> survey;
FunctionOf<&MapShadeKernels::pack> pack;
FunctionOf<&MapShadeKernels::least> least;
FunctionOf<&MapShadeKernels::greatest> greatest;

}  // namespace volsplat::VOLSPLAT_PATH
#endif
