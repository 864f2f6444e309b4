// Finds the voxels that can be seen, by two bits each: one for its density, one for its strength. Most voxels of a
// volume end here.
#include "kernels/packet_layout.h"
#include "kernels/wide_lanes.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

// Answers for as many packets as there are lanes; the bits lie in registers.
class Seen {
public:
    explicit Seen(const Visibility& visibility) : density_(visibility.density), strength_(visibility.strength) {}

    // A bit for each packet.
    std::uint32_t operator()(const std::uint32_t* packets) const {
        // A word of 32 bits is picked by the byte's upper bits
        return signs_of(packets, [this](auto packet) {
            return bit_as_sign(density_[packet >> 5], packet) & bit_as_sign(strength_[packet >> 13], packet >> 8) &
                   ~packet;
        });
    }

private:
    EightWords density_, strength_;
};

// The answers for `lanes` packets as one number.
template <int lanes>
std::uint64_t seen_of(const Seen& seen, const std::uint32_t* packets) {
    std::uint64_t all = 0;
    for (int lane = 0; lane < lanes; lane += kWidest) {
        all |= static_cast<std::uint64_t>(seen(packets + lane)) << lane;
    }
    return all;
}

}  // namespace

std::size_t classify_row(const std::uint32_t* row, std::size_t n, std::size_t first, const Visibility& visibility,
                         std::uint16_t* positions, std::uint32_t* packets) {
    constexpr int kTogether = 32;  // few stretches of so many voxels change between empty and not
    static_assert(kTogether <= kSpare);
    const Seen seen(visibility);
    std::size_t kept = 0;
    for (std::size_t at = 0; at < n; at += kTogether) {
        std::uint64_t bits = seen_of<kTogether>(seen, row + at);
        if (n - at < kTogether) bits &= (std::uint64_t{1} << (n - at)) - 1;
        if (bits == 0) continue;
        for (int lane = 0; lane < kTogether; lane += kWidest) {
            const std::uint32_t here = static_cast<std::uint32_t>(bits >> lane) & ((1u << kWidest) - 1);
            const std::size_t from = at + static_cast<std::size_t>(lane);
            const Integers lanes = counted_from(static_cast<std::int32_t>(first + from));
            store_chosen(positions + kept, here, (Words)lanes);
            store_chosen(packets + kept, here, row + from);
            kept += static_cast<unsigned>(__builtin_popcount(here));
        }
    }
    return kept;
}

void classify_columns(const std::uint32_t* source, std::ptrdiff_t stride, std::size_t n, std::uint64_t wanted,
                      const Visibility& visibility, const VoxelLanes& lanes, std::uint32_t* counts) {
    // So far ahead that the line has arrived from memory when it is needed, but not so far that lines a power of two
    // apart push each other out of the cache
    constexpr std::ptrdiff_t kLinesAhead = 8;
    constexpr std::ptrdiff_t kPacketsPerCacheLine = 16;
    const Seen seen(visibility);
    for (int lane = 0; lane < kStripLanes; ++lane) counts[lane] = 0;
    for (std::size_t at = 0; at < n; ++at) {
        const std::uint32_t* line = source + static_cast<std::ptrdiff_t>(at) * stride;
        for (int lane = 0; lane < kStripLanes; lane += kPacketsPerCacheLine) {
            __builtin_prefetch(line + kLinesAhead * stride + lane);
        }
        for (std::uint64_t bits = seen_of<kStripLanes>(seen, line) & wanted; bits != 0; bits &= bits - 1) {
            const int lane = __builtin_ctzll(bits);
            const std::size_t to = static_cast<std::size_t>(lane) * lanes.pitch + counts[lane]++;
            lanes.positions[to] = static_cast<std::uint16_t>(at);
            lanes.packets[to] = line[lane];
        }
    }
}

}  // namespace volsplat::VOLSPLAT_PATH
