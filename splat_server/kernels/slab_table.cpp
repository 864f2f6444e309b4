#include "slab_table.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace volsplat {

namespace {

constexpr int kPhases = 1 << kDepthBits;
constexpr int kIntervals = 4096;           // of the kernel over rho^2
constexpr double kLargestTable = 1 << 27;  // weights

int padded(int width) { return (width + kSliceLanes - 1) & -kSliceLanes; }

int pixels_to_a_side(double half_extent) {
    if (!(half_extent > 0 && half_extent < kLargestHalfExtent))
        throw std::invalid_argument("a kernel must have a finite size of less than 32768 pixels and planes");
    return static_cast<int>(std::ceil(half_extent));
}

// amplitude * kernel over rho^2 / radius^2 from 0 to 1.
std::vector<double> over_square(const KernelProjection& kernel, double amplitude) {
    std::vector<double> entries;
    for (int n = 0; n <= kIntervals; ++n)
        entries.push_back(amplitude * kernel.density(kernel.radius() * std::sqrt(double(n) / kIntervals)));
    entries.push_back(entries.back());
    return entries;
}

}  // namespace

SlabTable::SlabTable(const KernelProjection& kernel, const Ellipsoid& ellipsoid, int offset_bits, bool wide)
    : offset_bits_(offset_bits),
      wide_(wide),
      left_(pixels_to_a_side(ellipsoid.half_extents[0])),
      top_(pixels_to_a_side(ellipsoid.half_extents[1])),
      before_(pixels_to_a_side(ellipsoid.half_extents[2])) {
    if (offset_bits < 0 || offset_bits > kSubpixelBits)
        throw std::invalid_argument("a table of slices has 2^0 to 2^6 offsets a pixel");
    if (!(ellipsoid.amplitude >= 0 && std::isfinite(ellipsoid.amplitude)))
        throw std::invalid_argument("a kernel needs a finite amplitude");
    const double boxes = std::ldexp(kPhases, 2 * offset_bits);
    if (boxes * (2 * before_ + 2) * height() * padded(width()) > kLargestTable)
        throw std::invalid_argument("the table of slices is too large");
    if (wide) wide_weights_ = weights_of<std::uint64_t>(kernel, ellipsoid);
    else weights_ = weights_of<std::uint32_t>(kernel, ellipsoid);
}

template <class Number>
std::vector<typename SumLayout<Number>::Weight> SlabTable::weights_of(const KernelProjection& kernel,
                                                                      const Ellipsoid& ellipsoid) {
    typedef typename SumLayout<Number>::Weight Weight;
    const int offsets = 1 << offset_bits_, slices = 2 * before_ + 2, pitch = padded(width());
    const std::vector<double> table = over_square(kernel, ellipsoid.amplitude * SumLayout<Number>::kUnit);
    const double to_interval = kIntervals / (kernel.radius() * kernel.radius());
    const auto& q = ellipsoid.form;
    std::vector<typename SumLayout<Number>::Weight> weights(static_cast<std::size_t>(kPhases) * offsets * offsets *
                                                            slices * height() * pitch);
    spans_.assign(kPhases * slices, {height(), 0, pitch, 0});
    auto* row = weights.data();
    for (int phase = 0; phase < kPhases; ++phase)
        for (int box = 0; box < offsets * offsets; ++box)
            for (int slice = 0; slice < slices; ++slice) {
                SliceSpan& span = spans_[phase * slices + slice];
                const double d = slice - before_ - double(phase) / kPhases;
                for (int y = 0; y < height(); ++y, row += pitch) {
                    const double dy = y - top_ - double(box / offsets) / offsets;
                    for (int x = 0; x < width(); ++x) {
                        const double dx = x - left_ - double(box % offsets) / offsets;
                        const double square = q[0][0] * dx * dx + q[1][1] * dy * dy + q[2][2] * d * d +
                                              2 * (q[0][1] * dx * dy + q[0][2] * dx * d + q[1][2] * dy * d);
                        const double place = std::max(square, 0.0) * to_interval;
                        if (!(place < kIntervals)) continue;
                        const int cell = static_cast<int>(place);
                        const double weight = table[cell] + (place - cell) * (table[cell + 1] - table[cell]);
                        row[x] =
                            static_cast<Weight>(std::min(weight + 0.5, double(std::numeric_limits<Weight>::max())));
                        if (row[x] == 0) continue;
                        span = {std::min(span.row_begin, y), std::max(span.row_end, y + 1),
                                std::min(span.column_begin, x & -kSliceLanes),
                                std::max(span.column_end, (x & -kSliceLanes) + kSliceLanes)};
                    }
                }
            }
    return weights;
}

SlabTableView SlabTable::view() const {
    const void* weights = wide_ ? static_cast<const void*>(wide_weights_.data()) : weights_.data();
    return {weights,         spans_.data(), offset_bits_, 2 * before_ + 2, height(), width(),
            padded(width()), left_,         top_,         before_};
}

}  // namespace volsplat
