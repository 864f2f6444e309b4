#include "level_columns.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "kernels/constants.h"
#include "kernels/tables/patch_table.h"

namespace volsplat {

namespace {

constexpr double kHidden = 1.0 / 1024;  // as little as freezes a pixel
constexpr double kLeastColour = 1e-9;   // anything less reflects nothing
constexpr int kChildren = ColumnView::kRow - 1;

const VoxelLook kNothing{0.0, 0.0, {}};

// How much of a footprint's weight the four finer voxels across a bundle have, where there are four: see
// level_columns.py
constexpr double kAcross[] = {0.2, 0.3, 0.3, 0.2};

// A table of what voxels look like, and the light that is seen of them one after the other.
class Sight {
public:
    explicit Sight(const VoxelLook* table) : table_(table), reflected_(kLightSteps * kDirectionCodes) {}

    void begin() { through_ = 1.0; }
    double through() const { return through_; }

    // So much of a voxel.
    void see(std::uint32_t packet, double part) {
        const VoxelLook& look = of(packet);
        if (look.depth == 0.0) return;
        const double left = through_ * std::exp(-part * look.depth);
        add(packet, look, through_ - left);
        through_ = left;
    }

    // Eight, each so much of a layer, as one.
    void see_layer(const std::uint32_t* packets, double part) {
        double depth = 0.0;
        for (int n = 0; n < kChildren; ++n) depth += part * of(packets[n]).depth;
        if (depth == 0.0) return;
        const double left = through_ * std::exp(-depth), seen = part * (through_ - left) / depth;
        for (int n = 0; n < kChildren; ++n) {
            const VoxelLook& look = of(packets[n]);
            if (look.depth > 0.0) add(packets[n], look, seen * look.depth);
        }
        through_ = left;
    }

    // There is no step without the first.
    SeenLight seen() const {
        SeenLight all{emitted_, {}, {}};
        for (int code = 0; code < kDirectionCodes; ++code) {
            const double* const reflected = reflected_.data() + kLightSteps * code;
            if (reflected[0] == 0.0) continue;
            all.codes.push_back(code);
            all.reflected.insert(all.reflected.end(), reflected, reflected + kLightSteps);
        }
        return all;
    }

private:
    const VoxelLook& of(std::uint32_t packet) const {
        return packet >> kNoDataBit == 0 ? table_[packet & (kPlaneEntries - 1)] : kNothing;
    }

    void add(std::uint32_t packet, const VoxelLook& look, double part) {
        emitted_ += part * look.emitted;
        double* const reflected = reflected_.data() + kLightSteps * (packet >> kDirectionShift & (kDirectionCodes - 1));
        for (int step = 0; step < kLightSteps; ++step) reflected[step] += part * look.reflected[step];
    }

    const VoxelLook* table_;
    double emitted_ = 0.0, through_ = 1.0;
    std::vector<double> reflected_;  // kLightSteps to a direction code
};

double share_there(const ColumnView& view, const std::uint32_t* row) {
    int there = 0;
    for (int child = 1; child <= kChildren; ++child) there += row[child] != ColumnView::kBeyond;
    return static_cast<double>(there) / view.children();
}

void see_diagonal(const ColumnView& view, const std::uint32_t* row, Sight& fine, Sight& coarse) {
    coarse.see(*row, share_there(view, row));
    fine.see_layer(row + 1, 1.0 / view.children());
}

// What is seen of four rows abreast, in the order of a sheet's samples.
class Bundle {
public:
    explicit Bundle(const ColumnView& view) : view_(view) {
        const auto [a, b] = across(view.axis);
        const int width = view.factors[a], height = view.factors[b];
        for (int n = 0; n < ColumnView::kBundle; ++n)
            rows_[n] = turned(n / 2, 2, view.high_first[1]) * 2 + turned(n % 2, 2, view.high_first[0]);
        for (int m = 0; m < 2 * height; ++m)
            for (int n = 0; n < 2 * width; ++n) {
                const int at_a = turned(n, 2 * width, view.high_first[0]),
                          at_b = turned(m, 2 * height, view.high_first[1]);
                places_.push_back({at_b / height * 2 + at_a / width, (at_a % width) << a | (at_b % height) << b,
                                   weight(at_a, width) * weight(at_b, height)});
            }
    }

    void see(const std::uint32_t* rows, Sight& fine, Sight& coarse) const {
        for (const int n : rows_) {
            const std::uint32_t* const row = rows + n * ColumnView::kRow;
            coarse.see(*row, share_there(view_, row) / ColumnView::kBundle);
        }
        for (const int side : {int{view_.from_high}, int{!view_.from_high}})
            for (const Place& place : places_)
                fine.see(rows[place.row * ColumnView::kRow + 1 + (place.child | side << view_.axis)], place.part);
    }

private:
    struct Place {
        int row, child;
        double part;
    };

    static std::array<int, 2> across(int axis) { return {axis == 0 ? 1 : 0, axis == 2 ? 1 : 2}; }
    static int turned(int n, int size, bool high_first) { return high_first ? size - 1 - n : n; }
    static double weight(int at, int factor) { return factor == 2 ? kAcross[at] : 0.5; }

    const ColumnView& view_;
    std::array<int, ColumnView::kBundle> rows_;
    std::vector<Place> places_;  // of a layer
};

}  // namespace

SeenOfLevels seen_in_columns(const ColumnView& view, const VoxelLook* finer, const VoxelLook* coarser) {
    Sight fine(finer), coarse(coarser);
    const std::optional<Bundle> bundle = view.along_axis() ? std::optional<Bundle>(view) : std::nullopt;
    const int abreast = view.along_axis() ? ColumnView::kBundle : 1;
    std::int64_t begin = 0;
    for (std::size_t column = 0; column < view.columns; ++column) {
        const std::int64_t end = view.ends[column];
        fine.begin();
        coarse.begin();
        for (std::int64_t n = begin; n < end && (fine.through() > kHidden || coarse.through() > kHidden);
             n += abreast) {
            const std::int64_t at = view.from_high ? end - abreast - (n - begin) : n;
            const std::uint32_t* const rows = view.rows + at * ColumnView::kRow;
            if (bundle) bundle->see(rows, fine, coarse);
            else see_diagonal(view, rows, fine, coarse);
        }
        begin = end;
    }
    return {fine.seen(), coarse.seen()};
}

std::vector<double> reflected_in_steps(const double* refl, const double* room, std::size_t n, int channels,
                                       double step) {
    std::vector<double> reflected(kLightSteps * n);
    for (std::size_t voxel = 0; voxel < n; ++voxel)
        for (int channel = 0; channel < channels; ++channel) {
            const std::size_t at = channels * voxel + channel;
            const double part = refl[at] / channels, steps = room[at] / (step * std::max(refl[at], kLeastColour));
            for (int number = 0; number < kLightSteps; ++number)
                reflected[kLightSteps * voxel + number] += part * std::clamp(steps - number, 0.0, 1.0);
        }
    return reflected;
}

}  // namespace volsplat
