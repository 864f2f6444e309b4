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

// The bin of the coarser voxels << kBinBits | that of the finer ones or kNoDataBin, ascending, and how many of these
// there are. Of many different ones only the upper bits of the finer densities are told, with the middle of what they
// leave open.
struct MixtureEntries {
    std::vector<std::uint32_t> keys;
    std::vector<std::uint64_t> counts;
    int left_open = 0;  // bits of the finer densities

    // The entries of both: the same, whatever is added to what, and in which order.
    void add(const MixtureEntries& other);

    // The table of the coarser level in bins, from the finer one's.
    std::vector<double> mixed(const double* finer, std::size_t channels) const;

private:
    void leave_open(int bits);
};

// Of 2x2x2 finer voxels to each coarser one, fewer at an odd end, and along axes on which both have as many voxels.
// Throws std::invalid_argument for other sizes.
MixtureEntries mixture_of(const PacketView& finer, const PacketView& coarser);

// Of a table over density | strength << 8 with so many numbers to an entry: the mean of each bin, and zeros for no
// data.
std::vector<double> binned(const double* table, std::size_t channels);

// A table in bins over density | strength << 8.
std::vector<double> unbinned(const double* table, std::size_t channels);

}  // namespace volsplat
