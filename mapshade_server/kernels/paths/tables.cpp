// Fills the tables that change with the view: light of all directions, and opacity codes (paper: "Shading").
#include "kernels/compiler.h"
#include "kernels/packet_layout.h"
#include "kernels/powers.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

inline double magnitude(double x) { return x < 0.0 ? -x : x; }

// The nearest 12-bit code of 0..1, halves up; see protocol/rules/packet_layout.py.
inline std::uint16_t code_of_opacity(double opacity) {
    const double above = opacity > 0.0 ? opacity : 0.0;
    const double units = (above < 1.0 ? above : 1.0) * (kOpacityUnit * 256.0);
    const std::int32_t fine = static_cast<std::int32_t>(units + 0.5);  // in 1/256 of the smallest step
    // The width of a number in bits is told by its exponent as a float64
    const std::int32_t width = static_cast<std::int32_t>(bits_of(static_cast<double>(fine)) >> 52) - 1022;
    const std::int32_t exponent = width > 17 ? width - 16 : 1;
    const std::int32_t code = (exponent << 8) + ((fine + (1 << (exponent + 6))) >> (exponent + 7)) - 256;
    return static_cast<std::uint16_t>(code < kOpacityMask ? code : kOpacityMask);
}

template <bool two_sided, bool specular>
void fill_light(const DirectionVectors& axes, std::size_t n, const Lighting& lighting, float* ahead, float* behind) {
    const double *gx = axes.x, *gy = axes.y, *gz = axes.z;
    const double lx = lighting.light[0], ly = lighting.light[1], lz = lighting.light[2];
    const double hx = lighting.half[0], hy = lighting.half[1], hz = lighting.half[2];
    const double diffuse = lighting.diffuse ? 1.0 : 0.0, shininess = lighting.specular_power;
    VOLSPLAT_INDEPENDENT
    for (std::size_t axis = 0; axis < n; ++axis) {
        // The outward normal G is the opposite of the gradient; no direction, no light
        const double along_light = -(gx[axis] * lx + gy[axis] * ly + gz[axis] * lz);
        const double along_half = -(gx[axis] * hx + gy[axis] * hy + gz[axis] * hz);
        const double towards_light = magnitude(along_light), scattered = towards_light * diffuse;
        const double highlight = specular ? power_of(magnitude(along_half), shininess) : 0.0;
        const double sum_ahead = scattered + (two_sided || along_half > 0.0 ? highlight : 0.0);
        const double sum_behind = scattered + (two_sided || along_half < 0.0 ? highlight : 0.0);
        ahead[axis] = static_cast<float>((two_sided ? towards_light : along_light) > 0.0 ? sum_ahead : 0.0);
        behind[axis] = static_cast<float>((two_sided ? towards_light : -along_light) > 0.0 ? sum_behind : 0.0);
    }
}

}  // namespace

double power(double base, double exponent) { return power_of(base, exponent); }

void light(const DirectionVectors& axes, std::size_t n, const Lighting& lighting, float* ahead, float* behind) {
    const auto fill = lighting.two_sided ? (lighting.specular ? fill_light<true, true> : fill_light<true, false>)
                                         : (lighting.specular ? fill_light<false, true> : fill_light<false, false>);
    fill(axes, n, lighting, ahead, behind);
}

void opacity_codes(const double* thin, std::size_t n, double exponent, std::uint16_t* codes) {
    if (exponent == 1.0) {
        for (std::size_t at = 0; at < n; ++at) codes[at] = code_of_opacity(thin[at]);
    } else {
        for (std::size_t at = 0; at < n; ++at) codes[at] = code_of_opacity(1.0 - power_of(1.0 - thin[at], exponent));
    }
}

}  // namespace volsplat::VOLSPLAT_PATH
