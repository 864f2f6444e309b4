// Looks up opacity codes, and the bytes of packet fields that do not lie in the packet itself.
#include "kernels/packet_layout.h"
#include "kernels/wide_lanes.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

bool opacity_by_packet(const std::uint32_t* packets, std::size_t n, const std::uint16_t* table, std::uint16_t* codes) {
    Words below{};  // the sign of a lane is set once it has met a zero
    const auto look_up = [&](std::size_t at) {
        const Words found = looked_up(table, load<Words>(packets + at) & 0xFFFF);
        store_narrowed(codes + at, found);
        return found - 1;
    };
    std::size_t at = 0;
    for (; at + kWidest <= n; at += kWidest) below |= look_up(at);
    const std::uint32_t last = at < n ? signs(look_up(at)) & lanes_before(n - at) : 0;
    return (signs(below) | last) == 0;
}

bool opacity_by_indices(const TableIndices& opac, const TableIndices& modu, std::size_t n, const std::uint16_t* table,
                        std::uint16_t* codes) {
    bool none_zero = true;
    for (std::size_t at = 0; at < n; ++at) {
        codes[at] = table[opac.bytes[at * opac.spacing] | modu.bytes[at * modu.spacing] << 8];
        none_zero &= codes[at] != 0;
    }
    return none_zero;
}

void direction_bytes(const std::uint32_t* packets, std::size_t n, const std::uint8_t* table, std::uint8_t* bytes) {
    for (std::size_t at = 0; at < n; ++at) bytes[at] = table[packets[at] >> kDirectionShift & kDirectionMask];
}

void screen_bytes(const std::uint16_t* positions, std::size_t n, std::int64_t start, std::int64_t step,
                  std::uint8_t* bytes) {
    // In bytes and their fractions; exact, as all of start, step and their sums fit into a float64's mantissa
    constexpr double kUnit = 1.0 / 4294967296.0;
    const double from = static_cast<double>(start) * kUnit, by = static_cast<double>(step) * kUnit;
    for (std::size_t at = 0; at < n; ++at) {
        const double value = from + static_cast<double>(static_cast<std::int32_t>(positions[at])) * by;
        const double positive = value > 0.0 ? value : 0.0;
        bytes[at] = static_cast<std::uint8_t>(static_cast<std::int32_t>(positive < 255.0 ? positive : 255.0));
    }
}

void grid_bytes(const std::uint16_t* positions, std::size_t n, const std::uint8_t* table, std::int64_t step,
                std::uint8_t* bytes) {
    for (std::size_t at = 0; at < n; ++at) bytes[at] = table[positions[at] * step];
}

}  // namespace volsplat::VOLSPLAT_PATH
