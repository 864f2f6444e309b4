// Works each packet's position out from its ordinal, and looks its opacity up.
#include "batch_decoder.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "kernels/batch_code.h"

namespace volsplat {

namespace {

struct Palette {
    std::size_t count;
    std::array<std::uint64_t, kOpacityCodes> opacities;  // where a packet has them
};

std::uint32_t ordinal(std::uint64_t value) {
    if (value > std::numeric_limits<std::uint32_t>::max()) {
        throw std::invalid_argument("an ordinal has more than 32 bits");
    }
    return static_cast<std::uint32_t>(value);
}

Palette take_palette(CodeReader& code) {
    const auto take = [&] {
        PaletteNumber number;
        std::memcpy(&number, code.take(sizeof number), sizeof number);
        return number;
    };
    Palette palette{take(), {}};
    if (palette.count > kOpacityCodes) throw std::invalid_argument("its palette has more opacities than there are");
    for (std::size_t n = 0; n < palette.count; ++n) {
        const std::uint64_t opacity = take();
        if (opacity > kOpacityMask) throw std::invalid_argument("an opacity has more than 12 bits");
        palette.opacities[n] = opacity << kOpacityShift;
    }
    return palette;
}

// All but the origins of the runs, which follow from their packets.
void take_runs(CodeReader& code, const SampleLattice& lattice, const DecodedPart& part) {
    const std::uint64_t rows = lattice.levels[1].last + 1;
    if (rows == 0) throw std::invalid_argument("a sheet has no rows");
    std::uint64_t row = 0, first = 0;
    std::size_t packets = 0;
    for (std::size_t n = 0; n < part.run_count; ++n) {
        row += code.varint();
        first += unzigzag(code.varint());
        const std::uint64_t count = code.varint();
        if (count == 0 || count > part.packet_count - packets) {
            throw std::invalid_argument("a run has more packets than there are, or none");
        }
        part.runs[n] = {
            ordinal(row / rows), ordinal(row % rows), ordinal(first), static_cast<std::uint32_t>(count), 0, 0};
        packets += count;
    }
    if (packets != part.packet_count) throw std::invalid_argument("packets are left that no run has");
}

// How far from its first packet a run ends on an axis, in 1/64 pixel, if its offsets can say that.
std::int64_t extent(std::uint64_t steps, std::uint64_t step, std::uint64_t from) {
    std::int64_t distance, end;
    if (__builtin_mul_overflow(static_cast<std::int64_t>(steps), static_cast<std::int64_t>(step), &distance) ||
        __builtin_add_overflow(static_cast<std::int64_t>(from), distance, &end) ||
        std::abs(end >> kFinerBits) > kPositionMask) {
        throw std::invalid_argument("a run is longer than its offsets can say");
    }
    return end >> kFinerBits;
}

std::int32_t origin(std::int64_t wire) {
    if (std::abs(wire) > std::numeric_limits<std::int32_t>::max()) {
        throw std::invalid_argument("a run begins further away than 32 bits can say");
    }
    return static_cast<std::int32_t>(wire);
}

// The bytes of packets that the code has at fixed places.
struct Planes {
    const unsigned char *opacities, *gaps, *colours, *high_opacities;  // the last only if the palette is long
};

// Fills the packets of a run, and tells its origin.
void take_packets(CodeReader& code, const SampleLattice& lattice, const Palette& palette, const Planes& planes,
                  RowRun& run, std::uint64_t* packets) {
    const auto [step_x, step_y] = lattice.levels[2].step;
    const auto [first_x, first_y] = lattice.first_of(run);
    const std::int64_t head_x = on_wire(first_x), head_y = on_wire(first_y);
    // From the first packet's position, with what rounding adds
    constexpr std::uint64_t kHalf = std::uint64_t{1} << (kFinerBits - 1);
    const std::uint64_t from_x = first_x + kHalf - (static_cast<std::uint64_t>(head_x) << kFinerBits);
    const std::uint64_t from_y = first_y + kHalf - (static_cast<std::uint64_t>(head_y) << kFinerBits);
    std::uint64_t steps = 0;
    bool unknown = false;
    for (std::uint32_t n = 0;;) {
        const auto x = static_cast<std::int64_t>(from_x + steps * step_x) >> kFinerBits;
        const auto y = static_cast<std::int64_t>(from_y + steps * step_y) >> kFinerBits;
        std::size_t place = planes.opacities[n];
        if (planes.high_opacities) place |= static_cast<std::size_t>(planes.high_opacities[n]) << 8;
        unknown |= place >= palette.count;
        const unsigned char* const rgb = planes.colours + kColourBytes * n;
        const std::uint64_t colour = rgb[0] | rgb[1] << 8 | rgb[2] << 16;
        packets[n] = (static_cast<std::uint64_t>(x) + (static_cast<std::uint64_t>(y) << kPositionBits)) +
                     (palette.opacities[place & kOpacityMask] | colour << kColourShift);
        if (++n == run.count) break;
        steps += planes.gaps[n] + 1;
        if (planes.gaps[n] == kWideGap) steps += ordinal(code.varint());
    }
    if (unknown) throw std::invalid_argument("an opacity is not in its palette");

    const std::int64_t end_x = extent(steps, step_x, from_x), end_y = extent(steps, step_y, from_y);
    const std::int64_t back_x = std::min<std::int64_t>(end_x, 0), back_y = std::min<std::int64_t>(end_y, 0);
    run.x0 = origin(head_x + back_x);
    run.y0 = origin(head_y + back_y);
    if (back_x == 0 && back_y == 0) return;
    const std::uint64_t back =
        static_cast<std::uint64_t>(back_x) + (static_cast<std::uint64_t>(back_y) << kPositionBits);
    for (std::uint32_t n = 0; n < run.count; ++n) packets[n] -= back;
}

}  // namespace

void decode_batch(const unsigned char* code_bytes, std::size_t count, const std::vector<DecodedPart>& parts) {
    std::size_t packets = 0;
    for (const DecodedPart& part : parts) packets += part.packet_count;
    CodeReader code(code_bytes, count);
    const Palette palette = take_palette(code);
    SampleLattice lattice;
    std::memcpy(&lattice, code.take(sizeof lattice), sizeof lattice);
    Planes planes{code.take(packets), code.take(packets), code.take(kColourBytes * packets), nullptr};
    const std::size_t at_end = palette.count > kShortPalette ? packets : 0;
    for (const DecodedPart& part : parts) take_runs(code, lattice, part);
    if (at_end > code.left()) throw std::invalid_argument("it is cut short");
    if (at_end) planes.high_opacities = code_bytes + count - at_end;
    for (const DecodedPart& part : parts) {
        std::uint64_t* next = part.packets;
        for (std::size_t n = 0; n < part.run_count; ++n) {
            RowRun& run = part.runs[n];
            take_packets(code, lattice, palette, planes, run, next);
            next += run.count;
            planes.opacities += run.count;
            planes.gaps += run.count;
            planes.colours += kColourBytes * run.count;
            if (at_end) planes.high_opacities += run.count;
        }
    }
    if (code.left() != at_end) throw std::invalid_argument("it goes on behind its end");
}

}  // namespace volsplat
