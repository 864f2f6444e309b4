#include "mixtures.h"

#include <algorithm>
#include <array>
#include <stdexcept>

namespace volsplat {

namespace {

constexpr int kStrengths = 256;
constexpr std::size_t kRows = kNoDataBin + 1;

// Exact below kExactStrengths, from there on so many bins to each doubling.
constexpr std::array<std::uint32_t, kStrengths> bins_of_strengths() {
    std::array<std::uint32_t, kStrengths> bins{};
    for (int strength = 0; strength < kStrengths; ++strength) {
        int mantissa = strength, doublings = 0;
        for (; mantissa >= 2 * kExactStrengths; mantissa /= 2) ++doublings;
        bins[strength] = static_cast<std::uint32_t>(mantissa + kExactStrengths * doublings);
    }
    return bins;
}

constexpr std::array<std::uint32_t, kStrengths> kBinOfStrength = bins_of_strengths();

bool has_data(std::uint32_t packet) { return packet >> kNoDataBit == 0; }

std::uint32_t bin_of(std::uint32_t packet) { return (packet & 255) | kBinOfStrength[packet >> 8 & 255] << 8; }

}  // namespace

void MixtureCounts::add_voxels(const PacketView& finer, const PacketView& coarser) {
    for (int axis = 0; axis < 3; ++axis) {
        if (coarser.size[axis] != (finer.size[axis] + 1) / 2) {
            throw std::invalid_argument("of each axis a coarser level has half the voxels");
        }
    }
    std::uint32_t newest = 0;
    std::uint64_t run = 0;  // of `newest`, which are not added yet
    for (std::int64_t k = 0; k < finer.size[2]; ++k) {
        for (std::int64_t j = 0; j < finer.size[1]; ++j) {
            const std::uint32_t *voxels = finer.row(j, k), *means = coarser.row(j / 2, k / 2);
            for (std::int64_t i = 0; i < finer.size[0]; ++i) {
                const std::uint32_t mean = means[(i / 2) * coarser.step[0]], voxel = voxels[i * finer.step[0]];
                if (!has_data(mean)) continue;
                const std::uint32_t key = bin_of(mean) << kBinBits |
                                          (has_data(voxel) ? bin_of(voxel) : static_cast<std::uint32_t>(kNoDataBin));
                if (key == newest) {
                    ++run;
                    continue;
                }
                if (run > 0) add(newest, run);
                newest = key;
                run = 1;
            }
        }
    }
    if (run > 0) add(newest, run);
}

std::vector<MixtureEntry> MixtureCounts::by_key() const {
    std::vector<MixtureEntry> entries;
    entries.reserve(used_);
    for (const MixtureEntry& slot : slots_) {
        if (slot.count > 0) entries.push_back(slot);
    }
    std::sort(entries.begin(), entries.end(),
              [](const MixtureEntry& one, const MixtureEntry& other) { return one.key < other.key; });
    return entries;
}

void MixtureCounts::grow() {
    std::vector<MixtureEntry> before(2 * slots_.size());
    before.swap(slots_);
    for (const MixtureEntry& slot : before) {
        if (slot.count > 0) slot_of(slot.key) = slot;
    }
}

std::vector<double> binned(const double* table, std::size_t channels) {
    std::vector<double> rows(kRows * channels);
    std::array<double, kStrengthBins> strengths{};
    for (int strength = 0; strength < kStrengths; ++strength) {
        const std::uint32_t bin = kBinOfStrength[strength];
        strengths[bin] += 1.0;
        double* const sums = &rows[bin * 256 * channels];
        const double* const entries = &table[strength * 256 * channels];
        for (std::size_t n = 0; n < 256 * channels; ++n) sums[n] += entries[n];
    }
    for (std::size_t n = 0; n < kNoDataBin * channels; ++n) rows[n] /= strengths[n / (256 * channels)];
    return rows;
}

std::vector<double> mixed(const std::uint32_t* keys, const std::uint64_t* counts, std::size_t entries,
                          const double* finer, std::size_t channels) {
    std::vector<double> rows(kRows * channels);
    std::vector<double> sum(channels);
    for (std::size_t at = 0; at < entries;) {
        const std::uint32_t coarse = keys[at] >> kBinBits;
        double total = 0.0;
        std::fill(sum.begin(), sum.end(), 0.0);
        for (; at < entries && keys[at] >> kBinBits == coarse; ++at) {
            const double count = static_cast<double>(counts[at]);
            const double* const row = &finer[(keys[at] & ((1u << kBinBits) - 1)) * channels];
            total += count;
            for (std::size_t channel = 0; channel < channels; ++channel) sum[channel] += count * row[channel];
        }
        for (std::size_t channel = 0; channel < channels; ++channel)
            rows[coarse * channels + channel] = sum[channel] / total;
    }
    return rows;
}

std::vector<double> unbinned(const double* table, std::size_t channels) {
    std::vector<double> entries(kStrengths * 256 * channels);
    for (int strength = 0; strength < kStrengths; ++strength) {
        const double* const row = &table[kBinOfStrength[strength] * 256 * channels];
        std::copy(row, row + 256 * channels, &entries[strength * 256 * channels]);
    }
    return entries;
}

}  // namespace volsplat
