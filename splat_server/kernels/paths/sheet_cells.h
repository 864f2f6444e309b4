// Which pixel centres lie inside a sample's cell in its sheet (design, section 6: nearest pixel above one pixel a
// voxel). Decided in integers, from the indices: the cells of a sheet tile the image with no hole and no overlap.
#pragma once
#include "../splat_job.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

typedef __int128 Wide;

class SheetCells {
public:
    explicit SheetCells(const CellView& view) : view_(view) {
        // A pixel centre p lies at doubled row u and sample v where p - o = u * row half step + v * sample half step.
        row_x_ = view.half_step[0][1], row_y_ = view.half_step[1][1];
        sample_x_ = view.half_step[0][2], sample_y_ = view.half_step[1][2];
        area_ = Wide(row_x_) * sample_y_ - Wide(row_y_) * sample_x_;
        if (area_ < 0) {  // turn both signs, so that u and v are numerators over a positive area
            area_ = -area_;
            u_step_[0] = -sample_y_, u_step_[1] = sample_x_, v_step_[0] = row_y_, v_step_[1] = -row_x_;
        } else {
            u_step_[0] = sample_y_, u_step_[1] = -sample_x_, v_step_[0] = -row_y_, v_step_[1] = row_x_;
        }
    }

    // A sheet seen exactly edge on covers no pixel.
    bool empty() const { return area_ == 0; }

    void enter_row(uint32_t sheet, uint32_t row) {
        int64_t low, high;
        block(view_.axes[0], ordinal(view_.axes[0], sheet), low, high);
        for (int c = 0; c < 2; ++c) origin_[c] = view_.origin[c] + (low + high - 1) * view_.half_step[c][0];
        block(view_.axes[1], ordinal(view_.axes[1], row), low, high);
        u_low_ = 2 * low - 1, u_high_ = 2 * high - 1;
        row_middle_ = low + high - 1;
    }

    // The cell of the sample of this row nearest to a position in 1/64 pixel; false where it is far off any image.
    bool enter_cell(int64_t x64, int64_t y64) {
        constexpr double kFixed = 4294967296.0;
        const double dx = static_cast<double>(sample_x_), dy = static_cast<double>(sample_y_);
        const double from_x = static_cast<double>(x64) * (kFixed / 64) -
                              static_cast<double>(origin_[0] + row_middle_ * row_x_);
        const double from_y = static_cast<double>(y64) * (kFixed / 64) -
                              static_cast<double>(origin_[1] + row_middle_ * row_y_);
        const double middle = (from_x * dx + from_y * dy) / (dx * dx + dy * dy) / 2;
        const AxisView& axis = view_.axes[2];
        // Within half a voxel of its middle a block belongs to one ordinal only, so rounding cannot matter.
        const double place = (middle + 0.5 - static_cast<double>(axis.first - axis.stride / 2)) /
                             static_cast<double>(axis.stride);
        int64_t o = 0;
        if (place >= static_cast<double>(axis.count)) o = axis.count - 1;
        else if (place > 0) o = static_cast<int64_t>(place);
        int64_t low, high;
        block(axis, o, low, high);
        v_low_ = 2 * low - 1, v_high_ = 2 * high - 1;

        double y_min = 0, y_max = 0;
        for (int corner = 0; corner < 4; ++corner) {
            const double u = static_cast<double>(corner & 1 ? u_high_ : u_low_);
            const double v = static_cast<double>(corner & 2 ? v_high_ : v_low_);
            const double y = (static_cast<double>(origin_[1]) + u * static_cast<double>(row_y_) +
                              v * static_cast<double>(sample_y_)) / kFixed;
            if (corner == 0 || y < y_min) y_min = y;
            if (corner == 0 || y > y_max) y_max = y;
        }
        constexpr double kFarOff = 1e9;  // pixels
        if (!(y_max > -kFarOff && y_min < kFarOff)) return false;
        top_ = y_min > -kFarOff ? static_cast<int64_t>(y_min) - 2 : -int64_t(kFarOff);
        bottom_ = y_max < kFarOff ? static_cast<int64_t>(y_max) + 3 : int64_t(kFarOff);
        return true;
    }

    int64_t top() const { return top_; }        // rows that may hold pixels of the cell
    int64_t bottom() const { return bottom_; }  // one past the last

    // The pixels x_begin <= x < x_end of row y, within 0..width.
    void pixels_of_row(int64_t y, int64_t width, int64_t& x_begin, int64_t& x_end) const {
        const Wide from_x = -Wide(origin_[0]), from_y = (Wide(y) << 32) - origin_[1];
        x_begin = 0, x_end = width;
        narrow(from_x * u_step_[0] + from_y * u_step_[1], u_step_[0], u_low_, u_high_, x_begin, x_end);
        narrow(from_x * v_step_[0] + from_y * v_step_[1], v_step_[0], v_low_, v_high_, x_begin, x_end);
    }

private:
    static int64_t ordinal(const AxisView& axis, uint32_t visited) {
        return axis.ascending ? int64_t(visited) : axis.count - 1 - int64_t(visited);
    }

    static void block(const AxisView& axis, int64_t o, int64_t& low, int64_t& high) {
        const int64_t start = axis.first + axis.stride * o - axis.stride / 2;
        low = o == 0 ? axis.low : start;
        high = o == axis.count - 1 ? axis.high : start + axis.stride;
    }

    // Keeps of x_begin..x_end what has low * area <= at_zero + x * 2^32 * step < high * area.
    void narrow(Wide at_zero, int64_t step, int64_t low, int64_t high, int64_t& x_begin, int64_t& x_end) const {
        const Wide lower = Wide(low) * area_ - at_zero, upper = Wide(high) * area_ - at_zero;
        if (step == 0) {
            if (lower > 0 || upper <= 0) x_end = x_begin;
            return;
        }
        int64_t begin, end;
        if (step > 0) {
            begin = first_not_below(lower, step, x_begin, x_end);
            end = first_not_below(upper, step, x_begin, x_end);
        } else {  // x * -step > -upper and x * -step <= -lower
            begin = first_not_below(1 - upper, -step, x_begin, x_end);
            end = first_not_below(1 - lower, -step, x_begin, x_end);
        }
        x_begin = begin, x_end = end < begin ? begin : end;
    }

    // The least x in begin..end with x * 2^32 * step >= bound (or `end`), for step > 0.
    static int64_t first_not_below(Wide bound, int64_t step, int64_t begin, int64_t end) {
        const Wide stride = Wide(step) << 32;
        if (begin * stride >= bound) return begin;
        if (end * stride < bound) return end;
        int64_t x = static_cast<int64_t>(static_cast<double>(bound) / static_cast<double>(stride));
        if (x < begin) x = begin;
        if (x > end) x = end;
        while (x * stride < bound) ++x;
        while (x > begin && (x - 1) * stride >= bound) --x;
        return x;
    }

    const CellView& view_;
    int64_t row_x_, row_y_, sample_x_, sample_y_;
    Wide area_;
    int64_t u_step_[2], v_step_[2];
    int64_t origin_[2] = {0, 0};  // of the sheet
    int64_t u_low_ = 0, u_high_ = 0, v_low_ = 0, v_high_ = 0, row_middle_ = 0;
    int64_t top_ = 0, bottom_ = 0;
};

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
