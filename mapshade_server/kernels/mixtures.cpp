#include "mixtures.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

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

constexpr std::uint32_t kFinerBits = (1u << kBinBits) - 1;

// Ascending keys stay so.
std::uint32_t with_left_open(std::uint32_t key, int bits) {
    if (bits == 0 || (key & kFinerBits) == static_cast<std::uint32_t>(kNoDataBin)) return key;
    return (key >> bits << bits) | 1u << (bits - 1);
}

// Counts by key, in an open table.
class Counts {
public:
    Counts() : slots_(kLeastSlots) {}

    void add(std::uint32_t key, std::uint32_t count) {
        put(with_left_open(key, left_open_), count);
        if (2 * used_ > slots_.size()) grow();
    }

    // Nothing may be added afterwards.
    MixtureEntries entries() {
        std::vector<std::uint64_t> found;  // in one number each, as they sort sooner so
        found.reserve(used_);
        for (const Slot& slot : slots_)
            if (slot.count) found.push_back(std::uint64_t(slot.key) << 32 | slot.count);
        slots_ = {};
        std::sort(found.begin(), found.end());
        MixtureEntries sorted;
        sorted.left_open = left_open_;
        sorted.keys.reserve(used_), sorted.counts.reserve(used_);
        for (const std::uint64_t entry : found) {
            sorted.keys.push_back(static_cast<std::uint32_t>(entry >> 32));
            sorted.counts.push_back(entry & 0xffffffffu);
        }
        return sorted;
    }

private:
    static constexpr std::size_t kLeastSlots = 1 << 12;

    struct Slot {
        std::uint32_t key, count;  // a count of 0 is an empty one
    };

    void put(std::uint32_t key, std::uint32_t count) {
        const std::size_t last = slots_.size() - 1;
        std::size_t at = (key * 0x9E3779B97F4A7C15u) >> 20 & last;
        while (slots_[at].count && slots_[at].key != key) at = (at + 1) & last;
        if (slots_[at].count == 0) ++used_;
        slots_[at] = {key, slots_[at].count + count};
    }

    void grow() {
        const bool full = used_ > kMostMixtureEntries;
        if (full) ++left_open_;
        std::vector<Slot> before(full ? slots_.size() : 2 * slots_.size());
        before.swap(slots_);
        used_ = 0;
        for (const Slot& slot : before)
            if (slot.count) put(with_left_open(slot.key, left_open_), slot.count);
    }

    std::vector<Slot> slots_;  // as many as a power of 2
    std::size_t used_ = 0;
    int left_open_ = 0;
};

}  // namespace

MixtureEntries mixture_of(const PacketView& finer, const PacketView& coarser) {
    int halved[3];  // 1 if the axis is
    for (int axis = 0; axis < 3; ++axis) {
        halved[axis] = coarser.size[axis] != finer.size[axis];
        if (halved[axis] && coarser.size[axis] != (finer.size[axis] + 1) / 2)
            throw std::invalid_argument("of each axis a coarser level has half the voxels, or as many");
    }
    Counts counts;
    std::uint32_t newest = 0, run = 0;  // how many of the newest are not added yet
    for (std::int64_t k = 0; k < finer.size[2]; ++k) {
        for (std::int64_t j = 0; j < finer.size[1]; ++j) {
            const std::uint32_t *voxels = finer.row(j, k), *means = coarser.row(j >> halved[1], k >> halved[2]);
            for (std::int64_t i = 0; i < finer.size[0]; ++i) {
                const std::uint32_t mean = means[(i >> halved[0]) * coarser.step[0]], voxel = voxels[i * finer.step[0]];
                if (!has_data(mean)) continue;
                const std::uint32_t key = bin_of(mean) << kBinBits |
                                          (has_data(voxel) ? bin_of(voxel) : static_cast<std::uint32_t>(kNoDataBin));
                if (key != newest && run) counts.add(newest, std::exchange(run, 0));
                newest = key;
                ++run;
            }
        }
    }
    if (run) counts.add(newest, run);
    return counts.entries();
}

void MixtureEntries::leave_open(int bits) {
    left_open = bits;
    std::size_t last = 0;
    for (std::size_t n = 0; n < keys.size(); ++n) {
        const std::uint32_t key = with_left_open(keys[n], bits);
        if (n > 0 && key == keys[last]) {
            counts[last] += counts[n];
        } else {
            last = n ? last + 1 : 0;
            keys[last] = key, counts[last] = counts[n];
        }
    }
    if (keys.empty()) return;
    keys.resize(last + 1);
    counts.resize(last + 1);
}

void MixtureEntries::add(const MixtureEntries& other) {
    MixtureEntries sum, more = other;
    sum.left_open = std::max(left_open, other.left_open);
    if (left_open < sum.left_open) leave_open(sum.left_open);
    if (more.left_open < sum.left_open) more.leave_open(sum.left_open);
    sum.keys.reserve(keys.size() + more.keys.size());
    sum.counts.reserve(keys.size() + more.keys.size());
    for (std::size_t a = 0, b = 0; a < keys.size() || b < more.keys.size();) {
        const bool of_this = a < keys.size() && (b == more.keys.size() || keys[a] <= more.keys[b]);
        const bool of_other = b < more.keys.size() && (a == keys.size() || more.keys[b] <= keys[a]);
        sum.keys.push_back(of_this ? keys[a] : more.keys[b]);
        sum.counts.push_back((of_this ? counts[a++] : 0) + (of_other ? more.counts[b++] : 0));
    }
    while (sum.keys.size() > kMostMixtureEntries) sum.leave_open(sum.left_open + 1);
    *this = std::move(sum);
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

std::vector<double> MixtureEntries::mixed(const double* finer, std::size_t channels) const {
    std::vector<double> rows(kRows * channels);
    std::vector<double> sum(channels);
    for (std::size_t at = 0; at < keys.size();) {
        const std::uint32_t coarse = keys[at] >> kBinBits;
        double total = 0.0;
        std::fill(sum.begin(), sum.end(), 0.0);
        for (; at < keys.size() && keys[at] >> kBinBits == coarse; ++at) {
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
