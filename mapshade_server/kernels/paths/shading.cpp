// Colours the survivors of a row by tables and writes shaded packets (paper: "Shading").
//
// A colour is emit + refl * light, clamped to 0..1 and rounded to bytes, in float32. Positions are exact in float64:
// counted from the run's origin they have 14 bits before the point and 26 behind it.
#include "kernels/packet_layout.h"
#include "kernels/wide_lanes.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr double kLatticeUnit = 1.0 / 67108864.0;  // 1/64 pixel is 2^26 of the fixed-point unit
constexpr std::int64_t kHalfUnit = std::int64_t{1} << 25;

// Offsets from a run's origin along one axis, 1/64 pixel: n samples after the run's lowest one they are the whole
// part of start + n * step.
struct Offsets {
    double start, step;

    Offsets(std::int64_t row_start, std::int64_t row_step, std::int64_t lowest, std::int32_t origin)
        : start(static_cast<double>(row_start + lowest * row_step + kHalfUnit - (std::int64_t{origin} << 26)) *
                kLatticeUnit),
          step(static_cast<double>(row_step) * kLatticeUnit) {}

    Words at(Integers n) const { return whole_part(start, step, n); }
};

// As many samples at a time as there are lanes. Colours are worked on in four registers: number q holds every fourth
// sample from q on, so that packing to bytes leaves them in order.
template <bool plane>
class GroupShading {
public:
    GroupShading(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line,
                 const RunSamples& run)
        : samples_(samples),
          tables_(tables),
          lowest_(samples.voxels.positions[run.first]),
          x_(line.start_x, line.step_x, lowest_, run.origin_x),
          y_(line.start_y, line.step_y, lowest_, run.origin_y) {}

    // Writes the samples from s on to `out`, first to last or the other way round.
    void write(std::size_t s, bool descending, std::uint64_t* out) const {
        const Words colours = colours_of(s), codes = (Words)widened(samples_.opacity + s);
        const Integers n = widened(samples_.voxels.positions + s) - lowest_;
        const Words low = x_.at(n) | y_.at(n) << kPositionBits | codes << kOpacityShift;
        const Words high = codes >> (32 - kOpacityShift) | colours << (kColourShift - 32);
        store_pairs(out, low, high, descending);
    }

private:
    const float* emit(std::size_t s) const { return tables_.emit + 4 * entry(samples_.emit, s); }
    const float* refl(std::size_t s) const { return tables_.refl + 4 * entry(samples_.refl, s); }
    std::size_t entry(const TableIndices& indices, std::size_t s) const {
        if constexpr (plane) return samples_.voxels.packets[s] & 0xFFFF;
        return indices.bytes[s * indices.spacing];
    }

    template <int q>
    Integers levels(std::size_t s, Reals light) const {
        const Reals emitted = blocks([&](int block) { return emit(s + 4 * block + q); });
        const Reals reflected = blocks([&](int block) { return refl(s + 4 * block + q); });
        const Reals clamped = at_most_1(at_least_0(emitted + reflected * lane_of_blocks<q>(light)));
        return __builtin_convertvector(clamped * 255.0f + 0.5f, Integers);
    }

    // r | g << 8 | b << 16
    Words colours_of(std::size_t s) const {
        const Words packets = load<Words>(samples_.voxels.packets + s);
        const Reals light = looked_up(tables_.light, packets >> kDirectionShift & kDirectionMask);
        return bytes_of_blocks(levels<0>(s, light), levels<1>(s, light), levels<2>(s, light), levels<3>(s, light));
    }

    const SurvivingSamples& samples_;
    const ColourTables& tables_;
    const std::int32_t lowest_;
    const Offsets x_, y_;
};

template <bool plane>
void shade_run(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, const RunSamples& run,
               std::uint64_t* out) {
    const GroupShading<plane> shading(samples, tables, line, run);
    if (run.count < kWidest) {
        // Shade what lies behind the run too, but do not hand it out
        std::uint64_t all[kWidest];
        shading.write(run.first, run.descending, all);
        const std::uint64_t* ours = run.descending ? all + (kWidest - run.count) : all;
        for (std::size_t n = 0; n < run.count; ++n) out[n] = ours[n];
        return;
    }
    for (std::size_t done = 0; done < run.count; done += kWidest) {
        // The last group overlaps the one before
        const std::size_t at = done + kWidest <= run.count ? done : run.count - kWidest;
        shading.write(run.first + at, run.descending, out + (run.descending ? run.count - kWidest - at : at));
    }
}

}  // namespace

void shade(const SurvivingSamples& samples, const ColourTables& tables, const RowLine& line, const RunSamples& run,
           std::uint64_t* out) {
    (tables.plane ? shade_run<true> : shade_run<false>)(samples, tables, line, run, out);
}

}  // namespace volsplat::VOLSPLAT_PATH
