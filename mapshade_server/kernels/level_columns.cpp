#include "level_columns.h"

#include <algorithm>
#include <cmath>

#include "kernels/constants.h"
#include "kernels/tables/patch_table.h"

namespace volsplat {

namespace {

constexpr double kApart = 0.25;         // of the finer light along axes is that of columns for themselves
constexpr double kHidden = 1.0 / 1024;  // as little as freezes a pixel
constexpr double kLeastColour = 1e-9;   // anything less reflects nothing
constexpr int kPlaces = 8;              // of a layer at most

const VoxelLook kNothing{0.0, 1.0, 0.0, {}};

// A table of what voxels look like, and the light that is seen of them.
class Sight {
public:
    explicit Sight(const VoxelLook* table) : table_(table), reflected_(kLightSteps * kDirectionCodes) {}

    const VoxelLook& of(std::uint32_t packet) const {
        return packet >> kNoDataBit == 0 ? table_[packet & (kPlaneEntries - 1)] : kNothing;
    }

    // So much of a voxel.
    void add(std::uint32_t packet, const VoxelLook& look, double part) {
        emitted_ += part * look.emitted;
        double* const reflected = reflected_.data() + kLightSteps * (packet >> kDirectionShift & (kDirectionCodes - 1));
        for (int step = 0; step < kLightSteps; ++step) reflected[step] += part * look.reflected[step];
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
    const VoxelLook* table_;
    double emitted_ = 0.0;
    std::vector<double> reflected_;  // kLightSteps to a direction code
};

// What is left of the light behind the coarser level's voxels of a column.
class CoarserColumn {
public:
    CoarserColumn(Sight& sight, int children) : sight_(sight), children_(children) {}

    void begin() { through_ = 1.0; }
    double through() const { return through_; }

    void row(const std::uint32_t* row) {
        const VoxelLook& look = sight_.of(*row);
        if (look.depth == 0.0) return;
        int there = 0;
        for (int child = 1; child < ColumnView::kRow; ++child) there += row[child] != ColumnView::kBeyond;
        if (there == 0) return;
        const bool whole = there == children_;
        const double left = through_ * (whole ? look.through : std::exp(-look.depth * there / children_));
        sight_.add(*row, look, through_ - left);
        through_ = left;
    }

private:
    Sight& sight_;
    int children_;
    double through_ = 1.0;
};

// Likewise behind the layers of those that they stand for, and behind each column of these for itself, of which so
// much of the light is.
class FinerColumn {
public:
    FinerColumn(Sight& sight, int places, double apart) : sight_(sight), places_(places), part_apart_(apart) {}

    void begin() {
        through_ = 1.0;
        std::fill_n(apart_, kPlaces, 1.0);
    }
    double through() const { return through_; }

    // A layer of n of these packets.
    void layer(const std::uint32_t (&packets)[kPlaces], int count) {
        const VoxelLook* looks[kPlaces];
        double depth = 0.0, through = 1.0;
        for (int n = 0; n < count; ++n) {
            looks[n] = &sight_.of(packets[n]);
            depth += looks[n]->depth;
            through *= looks[n]->through;
        }
        if (depth == 0.0) return;
        for (int n = places_; n > 1; n /= 2) through = std::sqrt(through);
        const double left = through_ * through, seen = (1.0 - part_apart_) * (through_ - left) / depth;
        for (int n = 0; n < count; ++n) {
            if (looks[n]->depth == 0.0) continue;
            const double apart = apart_[n] * looks[n]->through;
            sight_.add(packets[n], *looks[n], seen * looks[n]->depth + part_apart_ / places_ * (apart_[n] - apart));
            apart_[n] = apart;
        }
        through_ = left;
    }

private:
    Sight& sight_;
    int places_;
    double part_apart_, through_ = 1.0, apart_[kPlaces];
};

// The packets that a row's voxel stands for, a layer at a time as the viewer sees them.
void finer_layers(const ColumnView& view, const std::uint32_t* row, FinerColumn& fine) {
    std::uint32_t packets[kPlaces];
    if (view.axis == ColumnView::kNoAxis) {
        std::copy_n(row + 1, kPlaces, packets);
        return fine.layer(packets, kPlaces);
    }
    for (const int side : {int{view.from_high}, int{!view.from_high}}) {
        int place = 0;
        for (int child = 0; child < kPlaces; ++child)
            if ((child >> view.axis & 1) == side) packets[place++] = row[child + 1];
        fine.layer(packets, place);
    }
}

}  // namespace

SeenOfLevels seen_in_columns(const ColumnView& view, const VoxelLook* finer, const VoxelLook* coarser) {
    Sight fine_sight(finer), coarse_sight(coarser);
    FinerColumn fine(fine_sight, view.places, view.axis == ColumnView::kNoAxis ? 0.0 : kApart);
    CoarserColumn coarse(coarse_sight, view.layers * view.places);
    std::int64_t begin = 0;
    for (std::size_t column = 0; column < view.columns; ++column) {
        const std::int64_t end = view.ends[column];
        fine.begin();
        coarse.begin();
        for (std::int64_t n = begin; n < end && (fine.through() > kHidden || coarse.through() > kHidden); ++n) {
            const std::int64_t at = view.from_high ? end - 1 - (n - begin) : n;
            const std::uint32_t* const row = view.rows + at * ColumnView::kRow;
            coarse.row(row);
            finer_layers(view, row, fine);
        }
        begin = end;
    }
    return {fine_sight.seen(), coarse_sight.seen()};
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
