// How a coded batch says what its runs and packets are: docs/how_it_works/protocol.md, "Coded batches".
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>

#include "kernels/packet_layout.h"
#include "kernels/rounding.h"

namespace volsplat {

// What of a batch is for one region; the bytes need no alignment.
struct RawPart {
    const unsigned char* runs;
    std::size_t run_count;
    const unsigned char* packets;
    std::size_t packet_count;
};

// Where samples lie by their ordinals: protocol/rules/sample_lattice.py. Whatever the numbers are, sums wrap.
struct SampleLattice {
    using Point = std::array<std::uint64_t, 2>;  // x and y, 2^-32 pixel

    struct Level {
        std::uint64_t last;  // ordinal
        Point step, at_first, at_last;
    };

    Point origin;
    std::array<Level, 3> levels;  // sheet, row, sample
    Thresholds thresholds;

    // The sample at ordinal 0 on the line through those whose blocks are not clipped, to be rounded to the nearest.
    Point line(std::uint64_t sheet, std::uint64_t row) const {
        const auto shift = static_cast<std::uint64_t>(thresholds.shift_of(sheet));
        Point start;
        for (int axis = 0; axis < 2; ++axis) start[axis] = origin[axis] + at(0, sheet, axis) + at(1, row, axis) + shift;
        return start;
    }

    // A run's first sample. A clipped one stands alone: it is not on the line of the others.
    Point first_of(const RowRun& run) const {
        Point point = line(run.sheet, run.row);
        for (int axis = 0; axis < 2; ++axis) {
            point[axis] += run.count == 1 ? at(2, run.first, axis) : run.first * levels[2].step[axis];
        }
        return point;
    }

private:
    std::uint64_t at(int level, std::uint64_t ordinal, int axis) const {
        const Level& of = levels[level];
        return ordinal * of.step[axis] + (ordinal == 0 ? of.at_first[axis] : 0) +
               (ordinal == of.last ? of.at_last[axis] : 0);
    }
};
constexpr std::size_t kLatticeNumbers = sizeof(SampleLattice) / sizeof(std::uint64_t);

using PaletteNumber = std::uint16_t;  // how many opacities there are, and each of them
constexpr std::size_t kLongestPalette = (1 + kOpacityCodes) * sizeof(PaletteNumber);
constexpr std::size_t kColourBytes = 3;
constexpr std::size_t kShortPalette = 256;  // a longer one needs two bytes for a place in it
constexpr int kWideGap = 255;               // what is beyond it stands elsewhere
constexpr std::size_t kLongestVarint = 10;

// No code of so many runs and packets has more bytes.
constexpr std::size_t largest_code(std::size_t runs, std::size_t packets) {
    return kLongestPalette + sizeof(SampleLattice) + 3 * kLongestVarint * runs +
           (2 + kColourBytes + kLongestVarint) * packets;
}

// In 1/64 pixel, rounded.
VOLSPLAT_INLINE std::int64_t on_wire(std::uint64_t fixed) {
    return static_cast<std::int64_t>(fixed + (std::uint64_t{1} << (kFinerBits - 1))) >> kFinerBits;
}

// Small numbers of either sign as small numbers.
VOLSPLAT_INLINE std::uint64_t zigzag(std::int64_t value) {
    return static_cast<std::uint64_t>(value) << 1 ^ static_cast<std::uint64_t>(value >> 63);
}
VOLSPLAT_INLINE std::uint64_t unzigzag(std::uint64_t coded) { return coded >> 1 ^ (0 - (coded & 1)); }

// Seven bits a byte, the lowest first; the last byte is below 128.
constexpr int kVarintBits = 7;
constexpr std::uint64_t kVarintMore = 1 << kVarintBits;

VOLSPLAT_INLINE unsigned char* put_varint(unsigned char* to, std::uint64_t value) {
    for (; value >= kVarintMore; value >>= kVarintBits) *to++ = static_cast<unsigned char>(value | kVarintMore);
    *to++ = static_cast<unsigned char>(value);
    return to;
}

// Takes what comes next of bytes that a stranger may have made. Throws std::invalid_argument.
class CodeReader {
public:
    CodeReader(const unsigned char* bytes, std::size_t count) : next_(bytes), end_(bytes + count) {}

    std::size_t left() const { return static_cast<std::size_t>(end_ - next_); }

    const unsigned char* take(std::size_t count) {
        if (count > left()) throw std::invalid_argument("it is cut short");
        next_ += count;
        return next_ - count;
    }

    VOLSPLAT_INLINE std::uint64_t varint() {
        if (next_ != end_ && *next_ < kVarintMore) return *next_++;
        return long_varint();
    }

private:
    std::uint64_t long_varint() {
        std::uint64_t value = 0;
        for (int shift = 0; shift < 64; shift += kVarintBits) {
            const std::uint64_t byte = *take(1);
            value |= (byte & (kVarintMore - 1)) << shift;
            if (byte < kVarintMore) return value;
        }
        throw std::invalid_argument("a number has more than 64 bits");
    }

    const unsigned char *next_, *end_;
};

}  // namespace volsplat
