#include "footprint_table.h"

#include <cmath>
#include <stdexcept>

namespace volsplat {
namespace {

// Keeps rounding noise in an extent from adding a column; the weight there is below 1e-6.
constexpr double kRimSlack = 1e-9;

int pixels_across(double half_extent) {
    return std::max(1, static_cast<int>(std::ceil(2 * (half_extent - kRimSlack))));
}

// Zeros on both sides of a row, so that the splat loop may read whole aligned vectors around it. Those after a row
// are those before the next.
int padded_row(int width) { return width + kRowPadding; }

}  // namespace

double FootprintTable::bytes_needed(const Ellipse& ellipse, int offset_bits) {
    const double rows = std::ldexp(1.0, 2 * offset_bits) * pixels_across(ellipse.half_height);
    return rows * padded_row(pixels_across(ellipse.half_width)) * sizeof(float);
}

FootprintTable::FootprintTable(const KernelProjection& projection, const Ellipse& ellipse, int offset_bits)
    : offset_bits_(offset_bits), clamped_(false) {
    if (offset_bits < 0 || offset_bits > kSubpixelBits)
        throw std::invalid_argument("a footprint table has 2^0 to 2^6 offsets a pixel");
    if (!(ellipse.half_width > 0 && ellipse.half_width < kLargestHalfExtent && ellipse.half_height > 0 &&
          ellipse.half_height < kLargestHalfExtent && std::isfinite(ellipse.amplitude)))
        throw std::invalid_argument("a footprint must have a finite size of less than 32768 pixels");
    width_ = pixels_across(ellipse.half_width);
    height_ = pixels_across(ellipse.half_height);
    pitch_ = padded_row(width_);
    const int n = 1 << offset_bits;
    const double half_width = ellipse.half_width - kRimSlack, half_height = ellipse.half_height - kRimSlack;
    for (int f = 0; f < n; ++f) {
        const double offset = static_cast<double>(f) / n;
        start_x_.push_back(static_cast<int>(std::floor(offset - half_width)) + 1);
        start_y_.push_back(static_cast<int>(std::floor(offset - half_height)) + 1);
    }
    const std::size_t rows = static_cast<std::size_t>(n) * n * height_;
    weights_.assign(rows * pitch_ + kRowPadding, 0.0f);
    spans_.resize(rows);
    std::size_t row = 0;
    for (int fy = 0; fy < n; ++fy)
        for (int fx = 0; fx < n; ++fx)
            for (int y = 0; y < height_; ++y, ++row) {
                const double dy = start_y_[fy] + y - static_cast<double>(fy) / n;
                float* weights = weights_.data() + row * pitch_ + kRowPadding;
                int begin = width_, end = 0;
                for (int x = 0; x < width_; ++x) {
                    const double dx = start_x_[fx] + x - static_cast<double>(fx) / n;
                    const double rho_square =
                        ellipse.qxx * dx * dx + 2 * ellipse.qxy * dx * dy + ellipse.qyy * dy * dy;
                    const auto weight = static_cast<float>(ellipse.amplitude * projection.at_square(rho_square));
                    if (!(weight > 0)) continue;
                    weights[x] = weight;
                    clamped_ = clamped_ || weight > 1;
                    begin = std::min(begin, x);
                    end = x + 1;
                }
                spans_[row] = {static_cast<std::uint16_t>(std::min(begin, end)), static_cast<std::uint16_t>(end)};
            }
}

std::tuple<int, int, std::vector<float>> FootprintTable::weights_at(int fx, int fy) const {
    const int n = 1 << offset_bits_;
    if (fx < 0 || fx >= n || fy < 0 || fy >= n) throw std::invalid_argument("no such offset in the footprint table");
    std::vector<float> box;
    const float* row = weights_.data() + static_cast<std::size_t>(fy * n + fx) * height_ * pitch_ + kRowPadding;
    for (int y = 0; y < height_; ++y, row += pitch_) box.insert(box.end(), row, row + width_);
    return {start_x_[fx], start_y_[fy], std::move(box)};
}

FootprintView FootprintTable::view() const {
    return {weights_.data(), spans_.data(), start_x_.data(), start_y_.data(), offset_bits_,
            width_,          height_,       pitch_,          clamped_};
}

}  // namespace volsplat
