// Means of a table over stretches of it: straight lines between its entries, constant beyond them.
#pragma once

#include <algorithm>
#include <array>

namespace volsplat {

constexpr int kTableEntries = 256;

// The entries are borrowed, and 0 to 1.
class TableMeans {
public:
    explicit TableMeans(const double* entries) : entries_(entries) {
        for (int n = 1; n < kTableEntries; ++n) sums_[n] = sums_[n - 1] + (entries[n - 1] + entries[n]) / 2.0;
    }

    double around(int entry, double half) const {
        if (half < kLeastHalf) return entries_[entry];
        return std::clamp((up_to(entry + half) - up_to(entry - half)) / (2.0 * half), 0.0, 1.0);
    }

private:
    double up_to(double place) const {
        constexpr int kLast = kTableEntries - 1;
        if (place <= 0.0) return entries_[0] * place;
        if (place >= kLast) return sums_[kLast] + entries_[kLast] * (place - kLast);
        const int below = static_cast<int>(place);
        const double part = place - below;
        return sums_[below] + part * (entries_[below] + (entries_[below + 1] - entries_[below]) * (part / 2.0));
    }

    static constexpr double kLeastHalf = 0.001;  // below, rounding errors of the sums would count

    const double* entries_;
    std::array<double, kTableEntries> sums_{};
};

}  // namespace volsplat
