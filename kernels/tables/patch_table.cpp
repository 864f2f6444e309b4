// Row by row of equal strength.
#include "patch_table.h"

#include <algorithm>
#include <cmath>

namespace volsplat {

namespace {

constexpr double kLast = kTableEntries - 1;
constexpr int kTableChannels = 6;  // emitted red, green, blue, and reflected

typedef std::array<double, kTableEntries> Entries;

struct Row {
    Entries opacity{};
    std::array<Entries, kTableChannels> colour{};  // times the opacity
    bool empty = true;
};

// How far up a rim of some width is what lies so far inside of a side; a side at the end of the plane has no rim.
double risen(double inside, double rim, bool at_end) { return at_end || inside >= rim ? 1.0 : inside / rim; }

// What patches give, summed up.
class RowSums {
public:
    explicit RowSums(double strength) : strength_(strength) { through_.fill(1.0); }

    void add(const Patch& patch) {
        const double low = patch.strength[0], high = patch.strength[1];
        if (strength_ < low || strength_ > high) return;
        const double up = (strength_ - low) / (high - low), rim = patch.soft * (high - low) / 2.0;
        const double rise =
            std::min(risen(strength_ - low, rim, low <= 0.0), risen(high - strength_, rim, high >= 1.0));
        const double left = patch.lower[0] + (patch.upper[0] - patch.lower[0]) * up;
        const double right = patch.lower[1] + (patch.upper[1] - patch.lower[1]) * up;
        const double side = patch.soft * (right - left) / 2.0;
        const int first = std::max(0, static_cast<int>(left * kLast)), last = static_cast<int>(right * kLast) + 1;
        for (int n = first; n <= std::min(last, kTableEntries - 1); ++n) {
            const double density = n / kLast;
            if (density < left || density > right) continue;
            const double inside =
                std::min(risen(density - left, side, left <= 0.0), risen(right - density, side, right >= 1.0));
            put(n, patch, patch.opacity * std::min(rise, inside));
        }
    }

    Row row() const {
        Row found;
        for (int n = 0; n < kTableEntries; ++n) {
            if (weight_[n] == 0.0) continue;
            found.empty = false;
            found.opacity[n] = 1.0 - through_[n];
            for (int channel = 0; channel < kTableChannels; ++channel) {
                found.colour[channel][n] = found.opacity[n] * (colour_[channel][n] / weight_[n]);
            }
        }
        return found;
    }

private:
    void put(int n, const Patch& patch, double opacity) {
        through_[n] *= 1.0 - opacity;
        weight_[n] += opacity;
        for (int channel = 0; channel < 3; ++channel) {
            colour_[channel][n] += opacity * patch.emit[channel];
            colour_[channel + 3][n] += opacity * patch.refl[channel];
        }
    }

    const double strength_;
    Entries through_{}, weight_{};
    std::array<Entries, kTableChannels> colour_{};
};

}  // namespace

PatchTable::PatchTable(const std::vector<Patch>& patches) {
    for (int strength = 0; strength < kTableEntries; ++strength) {
        RowSums sums(strength / kLast);
        for (const Patch& patch : patches) sums.add(patch);
        const Row row = sums.row();
        if (row.empty) continue;
        for (int n = 0; n < kTableEntries; ++n) {
            if (row.opacity[n] <= 0.0) continue;
            const int at = strength * kTableEntries + n;
            opacity[at] = row.opacity[n];
            for (int channel = 0; channel < kTableChannels; ++channel) {
                std::vector<float>& colour = channel < 3 ? emit : refl;
                const double mean = row.colour[channel][n] / row.opacity[n];
                colour[4 * at + channel % 3] = static_cast<float>(std::min(mean, 1.0));
            }
        }
    }
}

}  // namespace volsplat
