// Slides a window of three planes through a source, and hands its rows to the kernels.
#include "voxel_packets.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "paths/map_shade_kernels.h"

namespace volsplat {

namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

// Three planes of source values around the one that is worked on, with a rim of neighbours; NaN where there are none.
class PlaneWindow {
public:
    PlaneWindow(const SourceVolume& source, const Interior& interior)
        : source_(source), interior_(interior), pitch_(interior.size[0] + 2) {
        for (auto& plane : planes_) plane.resize(pitch_ * (interior.size[1] + 2) + kSpare);
        load(planes_[1], -1);
        load(planes_[2], 0);
    }

    void advance_to(std::int64_t k) {
        std::swap(planes_[0], planes_[1]);
        std::swap(planes_[1], planes_[2]);
        load(planes_[2], k + 1);
    }

    SourceRows rows(std::int64_t j) const { return {row(1, j), row(1, j - 1), row(1, j + 1), row(0, j), row(2, j)}; }

private:
    const double* row(int plane, std::int64_t j) const { return planes_[plane].data() + (j + 1) * pitch_ + 1; }

    // Reads the plane k of the interior with its rim, as far as the source reaches.
    void load(std::vector<double>& plane, std::int64_t k) const {
        const std::int64_t source_k = interior_.low[2] + k;
        const bool inside_k = source_k >= 0 && source_k < source_.size[2];
        const std::int64_t first_i = interior_.low[0] > 0 ? -1 : 0;
        const std::int64_t end_i =
            interior_.low[0] + interior_.size[0] < source_.size[0] ? interior_.size[0] + 1 : interior_.size[0];
        for (std::int64_t j = -1; j <= interior_.size[1]; ++j) {
            double* out = plane.data() + (j + 1) * pitch_ + 1;
            const std::int64_t source_j = interior_.low[1] + j;
            out[-1] = out[interior_.size[0]] = kMissing;
            if (inside_k && source_j >= 0 && source_j < source_.size[1]) {
                source_.read_row(source_k, source_j, interior_.low[0] + first_i, end_i - first_i, out + first_i);
            } else {
                for (std::int64_t i = 0; i < interior_.size[0]; ++i) out[i] = kMissing;
            }
        }
    }

    const SourceVolume& source_;
    const Interior& interior_;
    std::int64_t pitch_;
    std::vector<double> planes_[3];
};

// The strengths of a row: the lengths of its gradients, or what a second scalar holds.
class Strengths {
public:
    Strengths(const SourceVolume* second, std::int64_t n) : second_(second), row_(second ? n + kSpare : 0) {}

    const double* row(std::int64_t k, std::int64_t j, const GradientRow& gradient) {
        if (!second_) return gradient.length;
        second_->read_row(k, j, 0, second_->size[0], row_.data());
        return row_.data();
    }

private:
    const SourceVolume* second_;
    std::vector<double> row_;
};

// Calls visit(k, j, values, gradient) for each row of the interior.
template <typename Visit>
void for_each_row(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix,
                  const Visit& visit) {
    const std::int64_t n = interior.size[0];
    if (n * interior.size[1] * interior.size[2] == 0) return;
    const MapShadeKernels& kernels = map_shade_kernels();
    std::vector<double> numbers(4 * (n + kSpare));
    const std::int64_t pitch = n + kSpare;
    const GradientRow gradient{numbers.data(), numbers.data() + pitch, numbers.data() + 2 * pitch,
                               numbers.data() + 3 * pitch};
    PlaneWindow window(source, interior);
    for (std::int64_t k = 0; k < interior.size[2]; ++k) {
        window.advance_to(k);
        for (std::int64_t j = 0; j < interior.size[1]; ++j) {
            const SourceRows rows = window.rows(j);
            kernels.gradient(rows, n, matrix.data(), gradient);
            visit(k, j, rows.centre, gradient);
        }
    }
}

// Bins per unit of an evenly split range; 0 puts everything into the first bin.
double bins_per_unit(double low, double high) {
    const double scale = kHistogramBins / (high - low);
    return scale <= std::numeric_limits<double>::max() && scale > 0.0 ? scale : 0.0;
}

int bin(double offset, double scale) {
    const double place = offset * scale;
    return place < kHistogramBins ? (place > 0.0 ? static_cast<int>(place) : 0) : kHistogramBins - 1;
}

// The least and greatest value in each block, row by row; least above greatest where there is none.
class BlockExtremes {
public:
    explicit BlockExtremes(const Blocks& blocks)
        : blocks_(blocks), count_(blocks.count[0] * blocks.count[1] * blocks.count[2]), values_(2 * count_) {
        constexpr double kInfinity = std::numeric_limits<double>::infinity();
        std::fill(values_.begin(), values_.begin() + count_, kInfinity);
        std::fill(values_.begin() + count_, values_.end(), -kInfinity);
    }

    void take(std::int64_t k, std::int64_t j, const double* values, std::int64_t n) {
        const std::int64_t row = block(2, k) * blocks_.count[1] + block(1, j);
        for (std::int64_t i = 0; i < n;) {
            const std::int64_t place = block(0, i);
            const std::int64_t end = std::min(n, (place + 1) * blocks_.size[0] - blocks_.begin[0]);
            double& least = values_[row * blocks_.count[0] + place];
            double& greatest = values_[count_ + row * blocks_.count[0] + place];
            for (; i < end; ++i) {  // NaN is neither less nor greater
                if (values[i] < least) least = values[i];
                if (values[i] > greatest) greatest = values[i];
            }
        }
    }

    std::vector<double> taken() { return std::move(values_); }

private:
    std::int64_t block(int axis, std::int64_t index) const {
        return (blocks_.begin[axis] + index) / blocks_.size[axis];
    }

    Blocks blocks_;
    std::int64_t count_;
    std::vector<double> values_;
};

}  // namespace

RowExtremes survey(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    RowExtremes extremes{kInfinity, -kInfinity, 0.0, 0};
    for_each_row(source, interior, matrix, [&](std::int64_t, std::int64_t, const double* values, const GradientRow& g) {
        map_shade_kernels().survey(values, g.length, interior.size[0], &extremes);
    });
    return extremes;
}

Histograms histograms(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix,
                      const SourceVolume* second, const Range& density, const Range& strength, const Blocks& blocks) {
    Histograms counts{std::vector<std::int64_t>(kHistogramBins), std::vector<std::int64_t>(kHistogramBins), {}};
    BlockExtremes extremes(blocks);
    const double density_scale = bins_per_unit(density.low, density.high);
    const double strength_scale = bins_per_unit(strength.low, strength.high);
    Strengths strengths(second, interior.size[0]);
    for_each_row(source, interior, matrix,
                 [&](std::int64_t k, std::int64_t j, const double* values, const GradientRow& g) {
                     const double* row = strengths.row(k, j, g);
                     extremes.take(k, j, values, interior.size[0]);
                     for (std::int64_t i = 0; i < interior.size[0]; ++i) {
                         if (values[i] != values[i]) continue;
                         ++counts.density[bin(values[i] - density.low, density_scale)];
                         if (row[i] == row[i]) ++counts.strength[bin(row[i] - strength.low, strength_scale)];
                     }
                 });
    counts.extremes = extremes.taken();
    return counts;
}

void pack(const SourceVolume& source, const Interior& interior, const std::array<double, 9>& matrix,
          const SourceVolume* second, const QuantisationNumbers& numbers, std::uint32_t* packets) {
    const std::int64_t n = interior.size[0];
    Strengths strengths(second, n);
    for_each_row(source, interior, matrix,
                 [&](std::int64_t k, std::int64_t j, const double* values, const GradientRow& g) {
                     map_shade_kernels().pack(values, strengths.row(k, j, g), g, n, numbers,
                                              packets + (k * interior.size[1] + j) * n);
                 });
}

}  // namespace volsplat
