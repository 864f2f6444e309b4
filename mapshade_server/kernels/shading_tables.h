// The tables that a frame is shaded through: directions, light and opacity codes (paper: "Shading").
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/constants.h"
#include "kernels/tables/patch_table.h"
#include "paths/map_shade_kernels.h"
#include "rough_light.h"

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

// The same without signs: of two opposite directions one, since light needs much of the same for both.
struct AxisTable {
    explicit AxisTable(Directions code);

    std::vector<double> x, y, z;
    std::vector<std::uint16_t> place;  // of each code: its axis, and so many more as there are axes if it is opposite
};

const AxisTable& axis_table(Directions code);

// For each of three unit vectors along the grid's axes, the byte of every direction code: 3 x 32768.
std::vector<std::uint8_t> gradient_bytes(Directions code, const std::array<Vector3, 3>& axes);

// What multiplies the reflected colour, for every direction code; rough ones need `rough`.
std::vector<float> light_table(Directions code, const Lighting& lighting, const RoughLight* rough);

// 12-bit opacity codes of 1 - (1 - opac * modu)^exponent at opac index | modu index << 8.
std::vector<std::uint16_t> opacity_table(const double* opac, const double* modu, double exponent);

// Those of 1 - (1 - opacity)^exponent for the opacities of a table over density and strength.
std::vector<std::uint16_t> plane_opacity_codes(const double* opacities, double exponent);

}  // namespace volsplat
