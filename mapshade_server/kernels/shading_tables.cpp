// Fills the tables; see the header for what each of them holds.
#include "shading_tables.h"

#include <algorithm>
#include <cmath>

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

// The direction of a code as whole numbers, not normalised.
std::array<int, 3> whole_direction(int code, Directions directions) {
    if (directions == Directions::kPaper) return {(code & 31) - 16, (code >> 5 & 31) - 16, (code >> 10 & 31) - 16};
    if (directions == Directions::kOctahedral) {
        if (code >= kOctahedralNoGradient) return {0, 0, 0};
        return octahedral_direction(code, kOctahedralSide);
    }
    if (code >= kRoughnesses * kRoughDirections) return {0, 0, 0};
    return octahedral_direction(code % kRoughDirections, kRoughSide);
}

// Light that falls on directions spread evenly about an axis, whose angles to it have these cosines, by the cosine of
// the axis with the light: `shine` is what a cosine of one direction gives.
class SpreadLight {
public:
    template <class Shine>
    SpreadLight(const Cosines& cosines, Shine shine) {
        // Of eight directions around the axis, half of which mirror the others: cosines of odd sixteenths of pi
        constexpr double kAround[] = {0.98078528040323044913, 0.83146961230254523708, 0.55557023301960222474,
                                      0.19509032201612826785};
        for (int n = 0; n <= kSteps; ++n) {
            const double along = 2.0 * n / kSteps - 1.0, aside = std::sqrt(1.0 - along * along);
            double sum = 0.0;
            for (double cosine : cosines) {
                const double sine = std::sqrt(1.0 - cosine * cosine);
                for (double around : kAround) {
                    sum +=
                        shine(along * cosine + aside * sine * around) + shine(along * cosine - aside * sine * around);
                }
            }
            light_[n] = sum / (8.0 * static_cast<double>(cosines.size()));
        }
    }

    double at(double cosine) const {
        const double place = (std::clamp(cosine, -1.0, 1.0) + 1.0) * (kSteps / 2.0);
        const int below = std::min(static_cast<int>(place), kSteps - 1);
        return light_[below] + (light_[below + 1] - light_[below]) * (place - below);
    }

private:
    static constexpr int kSteps = 256;
    std::array<double, kSteps + 1> light_;
};

// The table's part for directions of one roughness.
void fill_rough_light(const DirectionTable& directions, int begin, const Cosines& cosines, const Lighting& lighting,
                      float* table) {
    const auto seen = [&](double cosine) { return lighting.two_sided ? std::abs(cosine) : cosine; };
    const auto power = map_shade_kernels().power;
    const SpreadLight diffuse(cosines, [&](double cosine) { return std::max(seen(cosine), 0.0); });
    const SpreadLight highlight(cosines, [&](double cosine) {
        return seen(cosine) > 0.0 ? power(std::min(seen(cosine), 1.0), lighting.specular_power) : 0.0;
    });
    const double* const half = lighting.half;
    const bool shines = lighting.specular && (half[0] != 0.0 || half[1] != 0.0 || half[2] != 0.0);
    for (int code = begin; code < begin + kRoughDirections; ++code) {
        // The outward normal is the opposite of the gradient
        const double x = -directions.x[code], y = -directions.y[code], z = -directions.z[code];
        const double along_light = x * lighting.light[0] + y * lighting.light[1] + z * lighting.light[2];
        const double along_half = x * half[0] + y * half[1] + z * half[2];
        double sum = lighting.diffuse ? diffuse.at(along_light) : 0.0;
        if (shines && seen(along_light) > 0.0) sum += highlight.at(along_half);
        table[code] = static_cast<float>(sum);
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

const DirectionTable& direction_table(Directions code) {
    static const DirectionTable paper(Directions::kPaper), octahedral(Directions::kOctahedral),
        rough(Directions::kRough);
    return code == Directions::kPaper ? paper : code == Directions::kOctahedral ? octahedral : rough;
}

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

std::vector<float> light_table(Directions code, const std::vector<Cosines>& roughness, const Lighting& lighting) {
    std::vector<float> table(kDirectionCodes, 0.0f);
    if (!lighting.diffuse && !lighting.specular) return table;
    const DirectionTable& directions = direction_table(code);
    map_shade_kernels().light({directions.x.data(), directions.y.data(), directions.z.data()}, kDirectionCodes,
                              lighting, table.data());
    if (code == Directions::kRough) {
        for (int n = 1; n < kRoughnesses; ++n) {
            fill_rough_light(directions, n * kRoughDirections, roughness.at(n), lighting, table.data());
        }
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
