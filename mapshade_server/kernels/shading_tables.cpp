// Fills the tables; see the header for what each of them holds.
#include "shading_tables.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "paths/map_shade_kernels.h"

namespace volsplat {

namespace {

int sign(int x) { return x < 0 ? -1 : 1; }

// A place on an octahedron unfolded to a square of so many places a side.
std::array<int, 3> octahedral_direction(int place, int side) {
    const int middle = side / 2, x = place % side - middle, y = place / side - middle;
    const int z = middle - std::abs(x) - std::abs(y);
    if (z >= 0) return {x, y, z};
    return {(middle - std::abs(y)) * sign(x), (middle - std::abs(x)) * sign(y), z};
}

// Where octahedral_direction() has this direction from; at a seam one of two places.
int octahedral_place(const std::array<int, 3>& direction, int side) {
    const auto [i, j, k] = direction;
    const int middle = side / 2;
    const int x = k >= 0 ? i : (middle - std::abs(j)) * sign(i), y = k >= 0 ? j : (middle - std::abs(i)) * sign(j);
    return (y + middle) * side + x + middle;
}

// Of rough directions.
bool is_two_faced(int code) { return code >= kFirstTwoFaced && code < kFirstTwoFaced + kTwoFacedDirections; }

// The direction of a code as whole numbers, not normalised.
std::array<int, 3> whole_direction(int code, Directions directions) {
    if (directions == Directions::kPaper) return {(code & 31) - 16, (code >> 5 & 31) - 16, (code >> 10 & 31) - 16};
    if (directions == Directions::kOctahedral) {
        if (code >= kOctahedralNoGradient) return {0, 0, 0};
        return octahedral_direction(code, kOctahedralSide);
    }
    if (code < kFirstTwoFaced) return octahedral_direction(code % kRoughDirections, kRoughSide);
    if (is_two_faced(code)) return octahedral_direction(code - kFirstTwoFaced, kTwoFacedSide);
    return {0, 0, 0};
}

// The code of the opposite direction, as rough as this one's; none of those without direction, nor of the paper's
// least.
std::optional<int> opposite(int code, Directions directions) {
    const auto [i, j, k] = whole_direction(code, directions);
    if (i == 0 && j == 0 && k == 0) return std::nullopt;
    if (directions == Directions::kOctahedral) return octahedral_place({-i, -j, -k}, kOctahedralSide);
    if (directions == Directions::kRough && is_two_faced(code))
        return kFirstTwoFaced + octahedral_place({-i, -j, -k}, kTwoFacedSide);
    if (directions == Directions::kRough)
        return code - code % kRoughDirections + octahedral_place({-i, -j, -k}, kRoughSide);
    if (std::min({i, j, k}) == -16) return std::nullopt;
    return (16 - i) | (16 - j) << 5 | (16 - k) << 10;
}

// Made when it is first asked for.
template <class Table>
const Table& table_of(Directions code) {
    if (code == Directions::kPaper) {
        static const Table paper(code);
        return paper;
    }
    if (code == Directions::kOctahedral) {
        static const Table octahedral(code);
        return octahedral;
    }
    static const Table rough(code);
    return rough;
}

// The table's part for directions of one roughness.
void fill_rough_light(int roughness, const RoughLight& rough, const Lighting& lighting, float* table) {
    const DirectionTable& directions = direction_table(Directions::kRough);
    const SpreadLight &diffuse = rough.diffuse(roughness), &highlight = rough.highlight(roughness);
    const double* const half = lighting.half;
    const bool shines = lighting.specular && (half[0] != 0.0 || half[1] != 0.0 || half[2] != 0.0);
    const int begin = roughness * kRoughDirections;
    for (int code = begin; code < begin + kRoughDirections; ++code) {
        // The outward normal is the opposite of the gradient
        const double x = -directions.x[code], y = -directions.y[code], z = -directions.z[code];
        const double along_light = x * lighting.light[0] + y * lighting.light[1] + z * lighting.light[2];
        const double along_half = x * half[0] + y * half[1] + z * half[2];
        double sum = lighting.diffuse ? diffuse.at(along_light) : 0.0;
        if (shines && (lighting.two_sided ? std::abs(along_light) : along_light) > 0.0) sum += highlight.at(along_half);
        table[code] = static_cast<float>(sum);
    }
}

// The table's part for two-faced directions: each side's light, the more of it the more the side faces the viewer.
// `both` has the light on each axis, then on its opposite.
void fill_two_faced_light(const AxisTable& axes, const std::vector<float>& both, const Lighting& lighting,
                          float* table) {
    const std::size_t count = axes.x.size();
    const auto along = [&](const double* v, std::size_t n) {
        return v[0] * axes.x[n] + v[1] * axes.y[n] + v[2] * axes.z[n];
    };
    const double *light = lighting.light, *half = lighting.half;
    const double twice = 2.0 * (light[0] * half[0] + light[1] * half[1] + light[2] * half[2]);
    for (int code = kFirstTwoFaced; code < kFirstTwoFaced + kTwoFacedDirections; ++code) {
        const std::size_t axis = axes.place[code] % count;
        // The outward normal is the opposite of the gradient, and the light is mirrored to the viewer at half way
        const double facing = kOfFacing * (along(light, axis) - twice * along(half, axis));
        table[code] = static_cast<float>(((1.0 + facing) * both[axis] + (1.0 - facing) * both[count + axis]) / 2.0);
    }
}

}  // namespace

DirectionTable::DirectionTable(Directions directions) {
    for (int code = 0; code < kDirectionCodes; ++code) {
        const auto [i, j, k] = whole_direction(code, directions);
        const double length = std::sqrt(static_cast<double>(i * i + j * j + k * k));
        if (length == 0.0) continue;
        x[code] = i / length;
        y[code] = j / length;
        z[code] = k / length;
    }
}

const DirectionTable& direction_table(Directions code) { return table_of<DirectionTable>(code); }

AxisTable::AxisTable(Directions directions) : place(kDirectionCodes) {
    const DirectionTable& all = direction_table(directions);
    std::vector<bool> flipped(kDirectionCodes);
    for (int code = 0; code < kDirectionCodes; ++code) {
        const int other = opposite(code, directions).value_or(code);
        if (other < code) {
            place[code] = place[other];
            flipped[code] = !flipped[other];
            continue;
        }
        place[code] = static_cast<std::uint16_t>(x.size());
        x.push_back(all.x[code]);
        y.push_back(all.y[code]);
        z.push_back(all.z[code]);
    }
    for (int code = 0; code < kDirectionCodes; ++code) {
        if (flipped[code]) place[code] = static_cast<std::uint16_t>(place[code] + x.size());
    }
}

const AxisTable& axis_table(Directions code) { return table_of<AxisTable>(code); }

std::vector<std::uint8_t> gradient_bytes(Directions scheme, const std::array<Vector3, 3>& axes) {
    const DirectionTable& directions = direction_table(scheme);
    std::vector<std::uint8_t> bytes(3 * kDirectionCodes);
    for (int axis = 0; axis < 3; ++axis) {
        const Vector3& unit = axes[axis];
        for (int code = 0; code < kDirectionCodes; ++code) {
            const double along =
                directions.x[code] * unit[0] + directions.y[code] * unit[1] + directions.z[code] * unit[2];
            bytes[axis * kDirectionCodes + code] =
                static_cast<std::uint8_t>(std::clamp(128.5 + 127.0 * along, 0.0, 255.0));
        }
    }
    return bytes;
}

std::vector<float> light_table(Directions code, const Lighting& lighting, const RoughLight* rough) {
    std::vector<float> table(kDirectionCodes, 0.0f);
    if (!lighting.diffuse && !lighting.specular) return table;
    const AxisTable& axes = axis_table(code);
    const std::size_t count = axes.x.size();
    std::vector<float> both(2 * count);
    map_shade_kernels().light({axes.x.data(), axes.y.data(), axes.z.data()}, count, lighting, both.data(),
                              both.data() + count);
    for (int direction = 0; direction < kDirectionCodes; ++direction) table[direction] = both[axes.place[direction]];
    if (code == Directions::kRough) {
        for (int n = 1; n < kRoughnesses; ++n) fill_rough_light(n, *rough, lighting, table.data());
        fill_two_faced_light(axes, both, lighting, table.data());
    }
    return table;
}

std::vector<std::uint16_t> opacity_table(const double* opac, const double* modu, double exponent) {
    std::vector<std::uint16_t> codes(kTableEntries * kTableEntries);
    std::array<double, kTableEntries> thin;
    for (int m = 0; m < kTableEntries; ++m) {
        std::uint16_t* row = &codes[m * kTableEntries];
        // Tables are often constant over long stretches
        if (m > 0 && modu[m] == modu[m - 1]) {
            std::copy(row - kTableEntries, row, row);
            continue;
        }
        for (int o = 0; o < kTableEntries; ++o) thin[o] = opac[o] * modu[m];
        map_shade_kernels().opacity_codes(thin.data(), kTableEntries, exponent, row);
    }
    return codes;
}

std::vector<std::uint16_t> plane_opacity_codes(const double* opacities, double exponent) {
    std::vector<std::uint16_t> codes(kPlaneEntries);
    map_shade_kernels().opacity_codes(opacities, kPlaneEntries, exponent, codes.data());
    return codes;
}

}  // namespace volsplat
