// Gradients and quantisation of one row of source values (paper: "Shading"; rules: protocol/rules/index_rules.py).
#include "kernels/compiler.h"
#include "kernels/packet_layout.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr double kLargest = 1.7976931348623157e308;
constexpr std::uint32_t kNoData = 1u << kNoDataBit;
constexpr std::uint32_t kNoDirection[] = {kPaperNoGradient, kOctahedralNoGradient};

// The change per step; NaN stands for a missing neighbour, and `here` takes its place.
inline double difference(double before, double here, double after) {
    const bool has_before = before == before, has_after = after == after;
    const double to = has_after ? after : here, from = has_before ? before : here;
    return (to - from) * (has_before && has_after ? 0.5 : 1.0);
}

inline double magnitude(double x) { return x < 0.0 ? -x : x; }
inline double sign(double x) { return x < 0.0 ? -1.0 : 1.0; }
inline double larger(double a, double b) { return a > b ? a : b; }

// Direction codes of gradients that are not zero; anything for those that are.
inline std::uint32_t octahedral_code(double x, double y, double z, bool none) {
    const double sum = magnitude(x) + magnitude(y) + magnitude(z);
    const double size = none ? 1.0 : sum;
    const double px = none ? 0.0 : x / size, py = none ? 0.0 : y / size;
    const bool fold = z < 0.0;
    const double folded_x = fold ? (1.0 - magnitude(py)) * sign(px) : px;
    const double folded_y = fold ? (1.0 - magnitude(px)) * sign(py) : py;
    const std::int32_t u = static_cast<std::int32_t>((folded_x + 1.0) * 90.0 + 0.5);
    const std::int32_t v = static_cast<std::int32_t>((folded_y + 1.0) * 90.0 + 0.5);
    return kOctahedralSide * static_cast<std::uint32_t>(v) + static_cast<std::uint32_t>(u);
}

// 16 more than the component scaled to -15..15, rounded half away from zero.
inline std::uint32_t paper_component(double c, double size) {
    const double scaled = c / size * 15.0;
    const double rounded = scaled < 0.0 ? scaled - 0.5 : scaled + 0.5;
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(rounded) + 16);
}

inline std::uint32_t paper_code(double x, double y, double z, bool none) {
    const double greatest = larger(larger(magnitude(x), magnitude(y)), magnitude(z));
    const double size = none ? 1.0 : greatest;
    return paper_component(none ? 0.0 : x, size) | paper_component(none ? 0.0 : y, size) << 5 |
           paper_component(none ? 0.0 : z, size) << 10;
}

// 0..255; NaN is 0.
inline double clamped(double level) { return level > 0.0 ? (level < 255.0 ? level : 255.0) : 0.0; }

template <bool octahedral>
void pack_row(const double* values, const double* strengths, const GradientRow& gradient, std::size_t n,
              const QuantisationNumbers& numbers, std::uint32_t* packets) {
    const double low = numbers.window_low, density_scale = numbers.density_scale;
    const double strength_low = numbers.strength_low, strength_scale = numbers.strength_scale;
    const double *gx = gradient.x, *gy = gradient.y, *gz = gradient.z, *length = gradient.length;
    for (std::size_t i = 0; i < n; ++i) {
        const double value = values[i];
        const bool no_data = value != value;
        const double density = clamped((value - low) * density_scale);
        const double strength = clamped((strengths[i] - strength_low) * strength_scale);
        const bool none = !(length[i] > 0.0);
        const std::uint32_t coded =
            octahedral ? octahedral_code(gx[i], gy[i], gz[i], none) : paper_code(gx[i], gy[i], gz[i], none);
        const std::uint32_t code = none ? kNoDirection[octahedral] : coded;
        const std::uint32_t packet = static_cast<std::uint32_t>(static_cast<std::int32_t>(density + 0.5)) |
                                     static_cast<std::uint32_t>(static_cast<std::int32_t>(strength + 0.5)) << 8 |
                                     code << kDirectionShift;
        packets[i] = no_data ? kNoData : packet;
    }
}

}  // namespace

void gradient(const SourceRows& rows, std::size_t n, const double* matrix, const GradientRow& out) {
    double m[9];
    for (int entry = 0; entry < 9; ++entry) m[entry] = matrix[entry];
    double *gx = out.x, *gy = out.y, *gz = out.z, *length = out.length;
    VOLSPLAT_INDEPENDENT
    for (std::size_t i = 0; i < n; ++i) {
        const double here = rows.centre[i];
        const double di = difference(rows.centre[static_cast<std::ptrdiff_t>(i) - 1], here, rows.centre[i + 1]);
        const double dj = difference(rows.j_before[i], here, rows.j_after[i]);
        const double dk = difference(rows.k_before[i], here, rows.k_after[i]);
        const double x = m[0] * di + m[1] * dj + m[2] * dk;
        const double y = m[3] * di + m[4] * dj + m[5] * dk;
        const double z = m[6] * di + m[7] * dj + m[8] * dk;
        const double size = __builtin_sqrt(x * x + y * y + z * z);
        gx[i] = x;
        gy[i] = y;
        gz[i] = z;
        length[i] = size <= kLargest ? size : 0.0;
    }
}

void survey(const double* values, const double* length, std::size_t n, RowExtremes* extremes) {
    constexpr std::size_t kLanes = 8;
    double low[kLanes], high[kLanes], steepest[kLanes];
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
        low[lane] = extremes->low;
        high[lane] = extremes->high;
        steepest[lane] = extremes->max_gradient;
    }
    // Comparisons with NaN are false, so that it never wins; a voxel without data has no gradient of its own
    std::int64_t no_data = 0;
    std::size_t at = 0;
    for (; at + kLanes <= n; at += kLanes) {
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
            const double value = values[at + lane];
            const double slope = value == value ? length[at + lane] : 0.0;
            low[lane] = value < low[lane] ? value : low[lane];
            high[lane] = value > high[lane] ? value : high[lane];
            steepest[lane] = slope > steepest[lane] ? slope : steepest[lane];
            no_data += value != value;
        }
    }
    for (; at < n; ++at) {
        const double value = values[at];
        const double slope = value == value ? length[at] : 0.0;
        low[0] = value < low[0] ? value : low[0];
        high[0] = value > high[0] ? value : high[0];
        steepest[0] = slope > steepest[0] ? slope : steepest[0];
        no_data += value != value;
    }
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
        extremes->low = low[lane] < extremes->low ? low[lane] : extremes->low;
        extremes->high = high[lane] > extremes->high ? high[lane] : extremes->high;
        extremes->max_gradient = steepest[lane] > extremes->max_gradient ? steepest[lane] : extremes->max_gradient;
    }
    extremes->no_data += no_data;
}

void pack(const double* values, const double* strengths, const GradientRow& gradient, std::size_t n,
          const QuantisationNumbers& numbers, std::uint32_t* packets) {
    if (numbers.octahedral) {
        pack_row<true>(values, strengths, gradient, n, numbers, packets);
    } else {
        pack_row<false>(values, strengths, gradient, n, numbers, packets);
    }
}

}  // namespace volsplat::VOLSPLAT_PATH
