// Declares the kernels of the instruction set that is being compiled.
#pragma once

#include "path_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

std::size_t compact(const std::uint32_t* row, std::size_t n, const std::uint32_t* visible, std::uint32_t* positions,
                    std::uint32_t* packets);
void transpose(const std::uint32_t* source, std::ptrdiff_t stride, std::size_t n, std::uint32_t* lanes,
               std::size_t pitch);
void shade(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, std::int32_t origin_x,
           std::int32_t origin_y, std::size_t first, std::size_t count, bool descending, std::uint64_t* out);
void gradient(const SourceRows& rows, std::size_t n, const double* matrix, const GradientRow& out);
void survey(const double* values, const double* length, std::size_t n, RowExtremes* extremes);
void pack(const double* values, const GradientRow& gradient, std::size_t n, const QuantisationNumbers& numbers,
          std::uint32_t* packets);

}  // namespace volsplat::VOLSPLAT_PATH
