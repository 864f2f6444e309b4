// What the voxels of a coarser level stand for: of all that have one density and strength, to the width of a bin
// (protocol/rules/packet_layout.py), how many voxels of the next finer level they are the means of, by the bins of
// those.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "kernels/constants.h"
#include "source_volume.h"

namespace volsplat {

// Packets of a box; steps are in packets.
struct PacketView {
    const std::uint32_t* first;
    Index3 size, step;

    const std::uint32_t* row(std::int64_t j, std::int64_t k) const { return first + j * step[1] + k * step[2]; }
};

// The bin of the coarser voxels, then that of the finer ones or kNoDataBin, with how many of these there are.
struct MixtureEntry {
    std::uint32_t key;
    std::uint64_t count;
};

// Counts by key, in an open table.
class MixtureCounts {
public:
    MixtureCounts() : slots_(kLeastSlots) {}

    // Of 2x2x2 finer voxels to each coarser one, fewer at an odd end. Throws std::invalid_argument for other sizes.
    void add_voxels(const PacketView& finer, const PacketView& coarser);

    void add(std::uint32_t key, std::uint64_t count) {
        MixtureEntry& slot = slot_of(key);
        if (slot.count == 0) {
            slot.key = key;
            ++used_;
        }
        slot.count += count;
        if (2 * used_ > slots_.size()) grow();
    }

    std::vector<MixtureEntry> by_key() const;

private:
    static constexpr std::size_t kLeastSlots = 1 << 12;

    MixtureEntry& slot_of(std::uint32_t key) {
        const std::size_t last = slots_.size() - 1;
        std::size_t at = (key * 0x9E3779B97F4A7C15u) >> 20 & last;
        while (slots_[at].count != 0 && slots_[at].key != key) at = (at + 1) & last;
        return slots_[at];
    }

    void grow();

    std::vector<MixtureEntry> slots_;  // as many as a power of 2; a count of 0 is an empty one
    std::size_t used_ = 0;
};

// Of a table over density | strength << 8 with so many numbers to an entry: the mean of each bin, and zeros for no
// data.
std::vector<double> binned(const double* table, std::size_t channels);

// The table of a coarser level in bins, from the next finer one's.
std::vector<double> mixed(const std::uint32_t* keys, const std::uint64_t* counts, std::size_t entries,
                          const double* finer, std::size_t channels);

// A table in bins over density | strength << 8.
std::vector<double> unbinned(const double* table, std::size_t channels);

}  // namespace volsplat
