// The tables that a frame is shaded through: directions, light and opacity codes (paper: "Shading").
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/constants.h"
#include "paths/map_shade_kernels.h"

namespace volsplat {

constexpr int kTableEntries = 256;

using Vector3 = std::array<double, 3>;

// Unit vectors of all direction codes; zeros for codes without direction.
struct DirectionTable {
    explicit DirectionTable(bool octahedral);

    std::vector<double> x = std::vector<double>(kDirectionCodes), y = x, z = x;
};

const DirectionTable& direction_table(bool octahedral);

// For each of three unit vectors along the grid's axes, the byte of every direction code: 3 x 32768.
std::vector<std::uint8_t> gradient_bytes(bool octahedral, const std::array<Vector3, 3>& axes);

// What multiplies the reflected colour, for every direction code.
std::vector<float> light_table(bool octahedral, const Lighting& lighting);

// 12-bit opacity codes of 1 - (1 - opac * modu)^exponent at opac index | modu index << 8.
std::vector<std::uint16_t> opacity_table(const double* opac, const double* modu, double exponent);

}  // namespace volsplat
