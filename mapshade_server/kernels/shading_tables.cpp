// Fills the tables; see the header for what each of them holds.
#include "shading_tables.h"

#include <algorithm>
#include <cmath>

#include "paths/map_shade_kernels.h"

namespace volsplat {

namespace {

constexpr int kMiddle = kOctahedralSide / 2;

int sign(int x) { return x < 0 ? -1 : 1; }

// The direction of a code as whole numbers, not normalised.
std::array<int, 3> whole_direction(int code, bool octahedral) {
    if (!octahedral) return {(code & 31) - 16, (code >> 5 & 31) - 16, (code >> 10 & 31) - 16};
    if (code >= kOctahedralNoGradient) return {0, 0, 0};
    const int x = code % kOctahedralSide - kMiddle, y = code / kOctahedralSide - kMiddle;
    const int z = kMiddle - std::abs(x) - std::abs(y);
    if (z >= 0) return {x, y, z};
    return {(kMiddle - std::abs(y)) * sign(x), (kMiddle - std::abs(x)) * sign(y), z};
}

}  // namespace

DirectionTable::DirectionTable(bool octahedral) {
    for (int code = 0; code < kDirectionCodes; ++code) {
        const auto [i, j, k] = whole_direction(code, octahedral);
        const double length = std::sqrt(static_cast<double>(i * i + j * j + k * k));
        if (length == 0.0) continue;
        x[code] = i / length;
        y[code] = j / length;
        z[code] = k / length;
    }
}

const DirectionTable& direction_table(bool octahedral) {
    static const DirectionTable octahedral_code(true), paper_code(false);
    return octahedral ? octahedral_code : paper_code;
}

std::vector<std::uint8_t> gradient_bytes(bool octahedral, const std::array<Vector3, 3>& axes) {
    const DirectionTable& directions = direction_table(octahedral);
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

std::vector<float> light_table(bool octahedral, const Lighting& lighting) {
    std::vector<float> table(kDirectionCodes, 0.0f);
    if (!lighting.diffuse && !lighting.specular) return table;
    const DirectionTable& directions = direction_table(octahedral);
    map_shade_kernels().light({directions.x.data(), directions.y.data(), directions.z.data()}, kDirectionCodes,
                              lighting, table.data());
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

}  // namespace volsplat
