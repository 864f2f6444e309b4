#include "footprint_table.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <mutex>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "paths/splat_kernels.h"

namespace volsplat {

namespace {

// Keeps rounding noise in an extent from adding a column; the weight there is below 1e-6.
constexpr double kRimSlack = 1e-9;

// Numbers of a band's weights that a thread keeps in its nearest cache.
constexpr int kWeightsOfBand = 1 << 11;

// Below, starting a thread takes longer than it saves.
constexpr std::size_t kWeightsWorthAThread = 1 << 14;

int pixels_across(double half_extent) {
    return std::max(1, static_cast<int>(std::ceil(2 * (half_extent - kRimSlack))));
}

// Where padding lies on the x axis, in pixels: no footprint reaches as far.
constexpr float kFarAway = 1e9f;

// The weights from one row to the next: a box's rows are whole vectors.
int padded(int width) { return width > kNarrowBox && width <= kWideBox ? kWideBox : (width + 3) & -4; }

int checked_offsets(int offset_bits) {
    if (offset_bits < 0 || offset_bits > kSubpixelBits)
        throw std::invalid_argument("a footprint table has 2^0 to 2^6 offsets a pixel");
    return 1 << offset_bits;
}

double checked_extent(double half_extent) {
    if (!(half_extent > 0 && half_extent < kLargestHalfExtent))
        throw std::invalid_argument("a footprint must have a finite size of less than 32768 pixels");
    return half_extent;
}

}  // namespace

double FootprintTable::bytes_needed(const Ellipse& ellipse, int offset_bits) {
    const double pixels =
        static_cast<double>(padded(pixels_across(ellipse.half_width))) * pixels_across(ellipse.half_height);
    return std::ldexp(pixels, 2 * offset_bits) * sizeof(float);
}

FootprintTable::Starts::Starts(double half_extent, int offsets) : step(offsets) {
    for (int f = 0; f < offsets; ++f) {
        at.push_back(static_cast<int>(std::floor(static_cast<double>(f) / offsets - half_extent + kRimSlack)) + 1);
        if (step == offsets && at[f] > at[0]) step = f;
    }
}

FootprintTable::FootprintTable(const KernelProjection& projection, const Ellipse& ellipse, int offset_bits, int threads)
    : offset_bits_(offset_bits),
      width_(pixels_across(checked_extent(ellipse.half_width))),
      height_(pixels_across(checked_extent(ellipse.half_height))),
      pitch_(padded(width_)),
      start_x_(ellipse.half_width, checked_offsets(offset_bits)),
      start_y_(ellipse.half_height, checked_offsets(offset_bits)) {
    if (!std::isfinite(ellipse.amplitude)) throw std::invalid_argument("a footprint needs a finite amplitude");
    clamped_ = ellipse.amplitude * projection.at_square(0) > 1;  // P falls from its middle on
    const int offsets = 1 << offset_bits;
    weight_count_ = static_cast<std::size_t>(offsets) * offsets * height_ * pitch_;
    memory_ = large_array<float>(weight_count_ + 2 * kWeightMargin);
    std::fill_n(memory_.get(), kWeightMargin, 0.0f);
    std::fill_n(weights() + weight_count_, kWeightMargin, 0.0f);
    const std::vector<float> scaled = projection.over_half_chord(ellipse.amplitude);
    const std::vector<float> x = columns_of_band();
    const auto intervals = static_cast<std::int32_t>(scaled.size()) - 2;
    const FootprintBox box{static_cast<float>(ellipse.qxx),
                           static_cast<float>(projection.radius() * projection.radius()),
                           static_cast<float>(intervals / projection.radius()),
                           scaled.data(),
                           intervals,
                           offsets,
                           start_x_.at.data(),
                           static_cast<std::size_t>(height_) * pitch_,
                           x.data()};
    fill(box, ellipse, threads);
}

int FootprintTable::rows_of_band() const { return std::clamp(kWeightsOfBand / pitch_, 1, height_); }

std::vector<float> FootprintTable::columns_of_band() const {
    std::vector<float> x(static_cast<std::size_t>(rows_of_band()) * pitch_ + kBandMargin, kFarAway);
    for (int y = 0; y < rows_of_band(); ++y) std::iota(x.begin() + y * pitch_, x.begin() + y * pitch_ + width_, 0.0f);
    return x;
}

// Each thread fills rows of offsets in turns, and finds what they reach.
void FootprintTable::fill(const FootprintBox& box, const Ellipse& ellipse, int threads) {
    spans_.assign(height_, {width_, 0});
    const std::size_t in_row = box.offsets * box.weights;
    std::atomic<int> next{0};
    std::mutex joining;  // guards what is found, and the first failure
    std::exception_ptr failure;
    const auto fill_some = [&] {
        for (int fy = next++; fy < box.offsets; fy = next++) {
            const float top = static_cast<float>(start_y_.at[fy]) - static_cast<float>(fy) / box.offsets;
            fill_row(box, ellipse, top, weights() + fy * in_row);
            const std::vector<RowSpan> reached = spans_of(weights() + fy * in_row, box.offsets);
            const std::lock_guard locked(joining);
            for (int y = 0; y < height_; ++y)
                spans_[y] = {std::min(spans_[y].begin, reached[y].begin), std::max(spans_[y].end, reached[y].end)};
        }
    };
    const auto work = [&] {
        try {
            fill_some();
        } catch (...) {
            const std::lock_guard locked(joining);
            if (!failure) failure = std::current_exception();
        }
    };
    {
        std::vector<std::jthread> helpers;
        const auto worth = static_cast<int>(weight_count_ / kWeightsWorthAThread);
        for (int n = 1; n < std::min({threads, box.offsets, worth}); ++n) helpers.emplace_back(work);
        work();
    }
    if (failure) std::rethrow_exception(failure);
}

void FootprintTable::fill_row(const FootprintBox& box, const Ellipse& ellipse, float top, float* row) const {
    std::vector<float> along_y(rows_of_band() * pitch_ + kBandMargin), twice_xy(along_y.size());
    const auto qyy = static_cast<float>(ellipse.qyy), qxy = static_cast<float>(ellipse.qxy);
    for (int first = 0; first < height_; first += rows_of_band()) {
        const int rows = std::min(rows_of_band(), height_ - first);
        for (int y = 0; y < rows; ++y) {
            const float dy = top + static_cast<float>(first + y);
            std::fill_n(along_y.begin() + y * pitch_, pitch_, qyy * dy * dy);
            std::fill_n(twice_xy.begin() + y * pitch_, pitch_, 2.0f * qxy * dy);
        }
        const FootprintBand band{static_cast<std::size_t>(rows) * pitch_, along_y.data(), twice_xy.data()};
        splat_kernels().fill_footprints(box, band, row + static_cast<std::size_t>(first) * pitch_);
    }
}

// What the rows of so many boxes reach together.
std::vector<RowSpan> FootprintTable::spans_of(const float* boxes, std::size_t count) const {
    std::vector<RowSpan> spans(height_, {width_, 0});
    const float* row = boxes;
    for (std::size_t box = 0; box < count; ++box)
        for (RowSpan& span : spans) {
            int begin = 0, end = width_;
            while (begin < span.begin && !(row[begin] > 0)) ++begin;
            while (end > span.end && !(row[end - 1] > 0)) --end;
            span = {std::min(begin, span.begin), std::max(end, span.end)};
            row += pitch_;
        }
    return spans;
}

std::tuple<int, int, std::vector<float>> FootprintTable::weights_at(int fx, int fy) const {
    const int n = 1 << offset_bits_;
    if (fx < 0 || fx >= n || fy < 0 || fy >= n) throw std::invalid_argument("no such offset in the footprint table");
    std::vector<float> box;
    const float* row = weights() + static_cast<std::size_t>(fy * n + fx) * height_ * pitch_;
    for (int y = 0; y < height_; ++y, row += pitch_) box.insert(box.end(), row, row + width_);
    return {start_x_.at[fx], start_y_.at[fy], std::move(box)};
}

FootprintView FootprintTable::view() const {
    return {weights(),    spans_.data(), start_x_.at[0], start_x_.step, start_y_.at[0], start_y_.step,
            offset_bits_, width_,        height_,        pitch_,        clamped_};
}

}  // namespace volsplat
