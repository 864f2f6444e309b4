#include "slab_table.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace volsplat {

namespace {

constexpr int kPhases = 1 << kDepthBits;
constexpr int kIntervals = 4096;            // of the kernel over rho^2
constexpr double kLargestTable = 1 << 27;   // weights
constexpr int kAround = 2 * kPlanesAtOnce;  // numbers before and behind that may be read

// As kLeastKnown, of kernels with weights below 0. On the edges of a volume weights sum to a quarter, in its corners to
// an eighth: rounding should not decide there.
constexpr double kSignedLeastKnown = 3.0 / 16;

int rounded_up(int number, int to) { return (number + to - 1) / to * to; }

double checked(double half_extent) {
    if (!(half_extent > 0 && half_extent <= kLargestHalfExtent))
        throw std::invalid_argument("a kernel reaches 16384 pixels and planes at most");
    return half_extent;
}

int offsets_of(int bits) {
    if (bits < 0 || bits > kSubpixelBits)
        throw std::invalid_argument("a table of slices has 2^0 to 2^6 offsets a pixel");
    return 1 << bits;
}

// For each offset the first place that lies within reach; its rim does not.
std::vector<std::int32_t> first_places(double half_extent, int offsets) {
    std::vector<std::int32_t> first;
    for (int n = 0; n < offsets; ++n)
        first.push_back(static_cast<std::int32_t>(std::floor(double(n) / offsets - half_extent)) + 1);
    return first;
}

int most_places(double half_extent, int offsets) {
    const std::vector<std::int32_t> first = first_places(half_extent, offsets);
    int most = 1;
    for (int n = 0; n < offsets; ++n)
        most = std::max(most, static_cast<int>(std::ceil(double(n) / offsets + half_extent)) - first[n]);
    return most;
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
      signed_(kernel.has_negative_weights()),
      columns_(most_places(checked(ellipsoid.half_extents[0]), offsets_of(offset_bits))),
      rows_(most_places(checked(ellipsoid.half_extents[1]), offsets_of(offset_bits))),
      slices_(most_places(checked(ellipsoid.half_extents[2]), kPhases)),
      left_(first_places(ellipsoid.half_extents[0], offsets_of(offset_bits))),
      top_(first_places(ellipsoid.half_extents[1], offsets_of(offset_bits))),
      front_(first_places(ellipsoid.half_extents[2], kPhases)),
      before_(static_cast<int>(std::ceil(ellipsoid.half_extents[2]))) {
    if (!(ellipsoid.amplitude >= 0 && std::isfinite(ellipsoid.amplitude)))
        throw std::invalid_argument("a kernel needs a finite amplitude");
    if (std::ldexp(kPhases, 2 * offset_bits) * slices_ * rows_ * columns_ > kLargestTable)
        throw std::invalid_argument("the table of slices is too large");
    if (wide) wide_slices_ = slices_of<std::uint64_t>(kernel, ellipsoid);
    else narrow_slices_ = slices_of<std::uint32_t>(kernel, ellipsoid);
}

int SlabTable::planes() const {
    const int last = kGroupPlanes - 1 + before_ + front_.back();  // that a voxel may reach first
    int planes = 0;
    for (int first = std::max(last - kPlaneStep + 1, 0); first <= last; ++first) {
        const int ahead = first % kPlaneStep;
        planes = std::max(planes, first - ahead + rounded_up(ahead + slices_, kPlanesAtOnce));
    }
    return rounded_up(planes, kBlockPlanes);
}

template <class Number>
SlabTable::Slices<Number> SlabTable::slices_of(const KernelProjection& kernel, const Ellipsoid& ellipsoid) {
    typedef typename SumLayout<Number>::Weight Weight;
    typedef std::numeric_limits<Weight> Limits;
    constexpr double kLeast = Limits::min(), kMost = Limits::max();
    const int offsets = 1 << offset_bits_;
    const std::vector<double> table = over_square(kernel, ellipsoid.amplitude * unit<Number>());
    const double to_interval = kIntervals / (kernel.radius() * kernel.radius());
    const auto& q = ellipsoid.form;
    std::vector<Weight> weights(static_cast<std::size_t>(kPhases) * offsets * offsets * slices_ * rows_ * columns_ +
                                2 * kAround);
    spans_.assign(kPhases * offsets * rows_, {columns_, 0});
    Weight* weight = weights.data() + kAround;
    for (int phase = 0; phase < kPhases; ++phase)
        for (int box = 0; box < offsets * offsets; ++box) {
            const int fx = box % offsets, fy = box / offsets;
            for (int y = 0; y < rows_; ++y) {
                RowSpan& span = spans_[(phase * offsets + fy) * rows_ + y];
                const double dy = y + top_[fy] - double(fy) / offsets;
                for (int x = 0; x < columns_; ++x) {
                    const double dx = x + left_[fx] - double(fx) / offsets;
                    for (int slice = 0; slice < slices_; ++slice, ++weight) {
                        const double d = slice + front_[phase] - double(phase) / kPhases;
                        const double square = q[0][0] * dx * dx + q[1][1] * dy * dy + q[2][2] * d * d +
                                              2 * (q[0][1] * dx * dy + q[0][2] * dx * d + q[1][2] * dy * d);
                        const double place = std::max(square, 0.0) * to_interval;
                        if (!(place < kIntervals)) continue;
                        const int cell = static_cast<int>(place);
                        const double found = table[cell] + (place - cell) * (table[cell + 1] - table[cell]);
                        *weight = static_cast<Weight>(std::clamp(std::floor(found + 0.5), kLeast, kMost));
                        if (*weight != 0) span = {std::min(span.begin, x), std::max(span.end, x + 1)};
                    }
                }
            }
        }
    std::vector<Number> bits(slices_ + 2 * kAround);
    std::fill_n(bits.begin() + kAround, slices_, ~Number{0});
    return {std::move(weights), std::move(bits)};
}

template <class Number>
double SlabTable::unit() const {
    return signed_ ? SumLayout<Number>::kSignedUnit : SumLayout<Number>::kUnit;
}

template <class Number>
SlabTableView SlabTable::view_of(const Slices<Number>& found) const {
    return {found.weights.data() + kAround,
            spans_.data(),
            found.bits.data() + kAround,
            left_.data(),
            top_.data(),
            front_.data(),
            signed_ ? SumLayout<Number>::kSignedBias : 0,
            static_cast<std::int32_t>((signed_ ? kSignedLeastKnown : kLeastKnown) * unit<Number>()),
            before_,
            offset_bits_,
            slices_,
            rows_,
            columns_};
}

SlabTableView SlabTable::view() const { return wide_ ? view_of(wide_slices_) : view_of(narrow_slices_); }

}  // namespace volsplat
