// The tables that a frame is shaded through: directions, light and opacity codes (paper: "Shading").
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/constants.h"
#include "kernels/tables/patch_table.h"
#include "paths/map_shade_kernels.h"

namespace volsplat {

using Vector3 = std::array<double, 3>;

// What a direction code stands for; see protocol/rules/index_rules.py.
enum class Directions { kPaper, kOctahedral, kRough };

// Unit vectors of all direction codes; zeros for codes without direction.
struct DirectionTable {
    explicit DirectionTable(Directions code);

    std::vector<double> x = std::vector<double>(kDirectionCodes), y = x, z = x;
};

const DirectionTable& direction_table(Directions code);

// For each of three unit vectors along the grid's axes, the byte of every direction code: 3 x 32768.
std::vector<std::uint8_t> gradient_bytes(Directions code, const std::array<Vector3, 3>& axes);

// Cosines of the angles between a mean direction and those that it stands for, all as likely.
using Cosines = std::vector<double>;

// What multiplies the reflected colour, for every direction code; `roughness` has the cosines of rough ones.
std::vector<float> light_table(Directions code, const std::vector<Cosines>& roughness, const Lighting& lighting);

// 12-bit opacity codes of 1 - (1 - opac * modu)^exponent at opac index | modu index << 8.
std::vector<std::uint16_t> opacity_table(const double* opac, const double* modu, double exponent);

// Those of 1 - (1 - opacity)^exponent for the opacities of a table over density and strength.
std::vector<std::uint16_t> plane_opacity_codes(const double* opacities, double exponent);

}  // namespace volsplat
