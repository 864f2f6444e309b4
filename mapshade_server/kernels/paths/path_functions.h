// Declares the kernels of the instruction set that is being compiled.
#pragma once

#include "path_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

std::size_t classify_row(const std::uint32_t* row, std::size_t n, std::size_t first, const Visibility& visibility,
                         std::uint16_t* positions, std::uint32_t* packets);
void classify_columns(const std::uint32_t* source, std::ptrdiff_t stride, std::size_t n, std::uint64_t wanted,
                      const Visibility& visibility, const VoxelLanes& lanes, std::uint32_t* counts);
std::size_t leave_out_hidden(const VisibleVoxels& voxels, const HiddenMap& map, const RowLine& line,
                             std::uint16_t* positions, std::uint32_t* packets);
bool opacity_by_packet(const std::uint32_t* packets, std::size_t n, const std::uint16_t* table, std::uint16_t* codes);
bool opacity_by_indices(const TableIndices& opac, const TableIndices& modu, std::size_t n, const std::uint16_t* table,
                        std::uint16_t* codes);
void direction_bytes(const std::uint32_t* packets, std::size_t n, const std::uint8_t* table, std::uint8_t* bytes);
void screen_bytes(const std::uint16_t* positions, std::size_t n, std::int64_t start, std::int64_t step,
                  std::uint8_t* bytes);
void grid_bytes(const std::uint16_t* positions, std::size_t n, const std::uint8_t* table, std::int64_t step,
                std::uint8_t* bytes);
void shade(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, const RunSamples& run,
           std::uint64_t* out);
double power(double base, double exponent);
void light(const DirectionVectors& directions, std::size_t n, const Lighting& lighting, float* table);
void opacity_codes(const double* thin, std::size_t n, double exponent, std::uint16_t* codes);
void gradient(const SourceRows& rows, std::size_t n, const double* matrix, const GradientRow& out);
void survey(const double* values, const double* length, std::size_t n, RowExtremes* extremes);
void pack(const double* values, const double* strengths, const GradientRow& gradient, std::size_t n,
          const QuantisationNumbers& numbers, std::uint32_t* packets);

}  // namespace volsplat::VOLSPLAT_PATH
