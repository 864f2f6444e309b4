// Which pixel centres lie inside the samples' cells in their sheet (design, section 6: nearest pixel above one pixel a
// voxel). The cells of a sheet tile the image with no hole and no overlap: what floating point cannot tell for certain
// is decided in integers, from the indices.
#pragma once
#include "../splat_job.h"
#include "pixel_vectors.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

typedef __int128 Wide;

constexpr double kFixedOne = 4294967296.0;  // 2^-32 pixel

inline int64_t floor_of(double value) {
    const auto truncated = static_cast<int64_t>(value);
    return truncated - (static_cast<double>(truncated) > value);
}

inline double size_of(double value) { return value < 0 ? -value : value; }

// Pixels along one coordinate from a sample to the next on an axis.
inline double pixels_apart(const CellView& cells, int coordinate, int axis) {
    return size_of(static_cast<double>(cells.half_step[coordinate][axis])) * 2 *
           static_cast<double>(cells.axes[axis].stride) / kFixedOne;
}

constexpr int kSpanRows = 8;
typedef int32_t RowInts __attribute__((vector_size(kSpanRows * 4)));
typedef int64_t RowBits __attribute__((vector_size(kSpanRows * 8)));
typedef double RowReals __attribute__((vector_size(kSpanRows * 8)));

inline bool any(const RowBits& bits) {
#ifdef __AVX512F__
    return _mm512_test_epi64_mask((__m512i)bits, (__m512i)bits) != 0;
#else
    FourBits parts[4];
    static_assert(sizeof parts == sizeof bits);
    __builtin_memcpy(parts, &bits, sizeof parts);
    return any(parts[0] | parts[1] | parts[2] | parts[3]);
#endif
}

// The pixels begin <= x < end of some image rows, one below the other.
struct RowSpans {
    RowInts begin, end;
};

// One doubled grid coordinate over the pixels of a sheet, as the fraction (constant + from x + from y) / area.
class CellCoordinate {
public:
    // Over the 2^-32 pixels from the sheet's origin; `area` is above 0.
    void set_slopes(int64_t per_x, int64_t per_y, Wide area) {
        per_x_ = per_x, per_y_ = per_y, area_ = area;
        slope_x_ = static_cast<double>(per_x) * (kFixedOne / static_cast<double>(area));
        slope_y_ = static_cast<double>(per_y) * (kFixedOne / static_cast<double>(area));
        pixels_ = per_x == 0 ? 0 : 1 / slope_x_;
    }

    // For block_numbers: block n begins at the doubled coordinate 2 * (first + n * size) - 1.
    void set_blocks(int64_t first, int64_t size) {
        first_block_ = 2 * first - 1, block_size_ = 2 * size;
        blocks_per_unit_ = 1 / static_cast<double>(block_size_);
    }

    void enter_sheet(int64_t origin_x, int64_t origin_y, int width, int height) {
        at_zero_ = -Wide(origin_x) * per_x_ - Wide(origin_y) * per_y_;
        constant_ = static_cast<double>(at_zero_) / static_cast<double>(area_);
        width_ = width;
        constexpr double kRounding = 1.0 / (int64_t(1) << 47);  // of all that is added up, well above 2^-53
        const double greatest = size_of(constant_) + size_of(slope_x_) * width + size_of(slope_y_) * height;
        doubt_ = kRounding * (2 * greatest + 1) * size_of(pixels_);
        block_doubt_ = kRounding * (2 * greatest + size_of(static_cast<double>(first_block_)) + 1) * blocks_per_unit_;
    }

    // Whether floating point leaves no more than two neighbouring blocks in question, as block_numbers needs it.
    bool tells_blocks() const { return block_doubt_ < 0.5; }

    // Of eight pixels from (x, y) on the blocks that they lie in; of those beyond `least` or `greatest` these.
    RowInts block_numbers(int64_t x, int64_t y, int64_t least, int64_t greatest) const {
        const RowReals across = {0, 1, 2, 3, 4, 5, 6, 7};
        const double at_row = constant_ + slope_y_ * static_cast<double>(y) - static_cast<double>(first_block_);
        RowReals place = (at_row + slope_x_ * (static_cast<double>(x) + across)) * blocks_per_unit_;
        const double low = static_cast<double>(least) + 0.5, high = static_cast<double>(greatest) + 0.5;
        place = place < low ? RowReals{} + low : place;
        place = place > high ? RowReals{} + high : place;
        RowInts numbers = __builtin_convertvector(place, RowInts);
        const RowReals within = place - __builtin_convertvector(numbers, RowReals);
        const RowBits doubtful = (within <= block_doubt_) | (within >= 1 - block_doubt_);
        if (any(doubtful))
            for (int n = 0; n < kSpanRows; ++n)
                if (doubtful[n]) numbers[n] = block_at(x + n, y, numbers[n] + (within[n] > 0.5));
        return numbers;
    }

    // Whether the coordinate is the same all along a row.
    bool level() const { return per_x_ == 0; }

    // Of these rows, where it is level, those with low <= coordinate < high.
    RowSpan rows_between(int64_t low, int64_t high, RowSpan rows) const {
        const int32_t begin = first_row_beyond(per_y_ < 0 ? high : low, rows.begin, rows.end);
        return {begin, first_row_beyond(per_y_ < 0 ? low : high, begin, rows.end)};
    }

    // Narrows the spans of the rows from `y` on to the pixels with low <= coordinate < high, where it is not level.
    void narrow(int64_t y, int64_t low, int64_t high, RowSpans& spans) const {
        if (!narrow_if_certain(y, low, high, spans)) narrow_exactly(y, low, high, spans);
    }

private:
    // Leaves the spans alone and says no where a bound lies so near to a pixel's centre that rounding could decide.
    bool narrow_if_certain(int64_t y, int64_t low, int64_t high, RowSpans& spans) const {
        const RowReals down = {0, 1, 2, 3, 4, 5, 6, 7};
        const RowReals rows = constant_ + slope_y_ * (static_cast<double>(y) + down);
        RowBits doubtful{};
        // The first pixel beyond a bound; off the image any will do
        const auto first_beyond = [&](int64_t bound) {
            RowReals place = (static_cast<double>(bound) - rows) * pixels_ + 1;
            place = place < 0.5 ? RowReals{} + 0.5 : place;
            place = place > width_ + 1.5 ? RowReals{} + (width_ + 1.5) : place;
            const RowInts first = __builtin_convertvector(place, RowInts);
            const RowReals within = place - __builtin_convertvector(first, RowReals);
            doubtful |= (within <= doubt_) | (within >= 1 - doubt_);
            return first;
        };
        const RowInts begin = first_beyond(per_x_ < 0 ? high : low), end = first_beyond(per_x_ < 0 ? low : high);
        if (any(doubtful)) return false;
        spans.begin = begin > spans.begin ? begin : spans.begin;
        spans.end = end < spans.end ? end : spans.end;
        return true;
    }

    void narrow_exactly(int64_t y, int64_t low, int64_t high, RowSpans& spans) const {
        for (int n = 0; n < kSpanRows; ++n) {
            const int32_t begin = spans.begin[n], end = spans.end[n];
            if (begin >= end) continue;
            const int32_t from = first_beyond(per_x_ < 0 ? high : low, y + n, begin, end);
            spans.begin[n] = from;
            spans.end[n] = first_beyond(per_x_ < 0 ? low : high, y + n, from, end);
        }
    }

    Wide at(int64_t x, int64_t y) const { return at_zero_ + (Wide(x) << 32) * per_x_ + (Wide(y) << 32) * per_y_; }

    // The one of two neighbouring blocks, by the number of the second, that a pixel lies in.
    int32_t block_at(int64_t x, int64_t y, int32_t second) const {
        const int64_t bound = first_block_ + second * block_size_;
        return at(x, y) < bound * area_ ? second - 1 : second;
    }

    // The first pixel of begin..end where a rising coordinate is no longer below `bound`, a falling one is, or `end`.
    int32_t first_beyond(int64_t bound, int64_t y, int32_t begin, int32_t end) const {
        return first_of(begin, end, [&](int32_t x) {
            return per_x_ < 0 ? at(x, y) < bound * area_ : at(x, y) >= bound * area_;
        });
    }

    // The same of rows; floating point tells where to look.
    int32_t first_row_beyond(int64_t bound, int32_t begin, int32_t end) const {
        const auto is_beyond = [&](int32_t y) {
            return per_y_ < 0 ? at(0, y) < bound * area_ : at(0, y) >= bound * area_;
        };
        const double place = (static_cast<double>(bound) - constant_) / slope_y_;
        const int32_t near = place < begin ? begin : place > end ? end : static_cast<int32_t>(place);
        const int32_t low = near - 1 > begin ? near - 1 : begin, high = near + 2 < end ? near + 2 : end;
        if ((low > begin && is_beyond(low)) || (high < end && !is_beyond(high))) return first_of(begin, end, is_beyond);
        return first_of(low, high, is_beyond);
    }

    // The first of begin..end from which on something is true, or `end`.
    template <class IsTrue>
    static int32_t first_of(int32_t begin, int32_t end, const IsTrue& is_true) {
        while (begin < end) {
            const int32_t middle = begin + (end - begin) / 2;
            if (is_true(middle)) end = middle;
            else begin = middle + 1;
        }
        return begin;
    }

    int64_t per_x_ = 0, per_y_ = 0;
    Wide area_ = 1, at_zero_ = 0;
    double slope_x_ = 0, slope_y_ = 0, constant_ = 0;
    double pixels_ = 0;  // for which the coordinate changes by 1
    double doubt_ = 0;   // pixels: nearer than this to a pixel's centre a crossing must be decided in integers
    int width_ = 0;
    int64_t first_block_ = 0, block_size_ = 1;
    double blocks_per_unit_ = 1;
    double block_doubt_ = 0;  // blocks: nearer than this to its end a pixel's block must be decided in integers
};

class SheetCells {
public:
    explicit SheetCells(const SplatJob& job) : job_(job), view_(job.cell) {
        // A pixel centre p lies at doubled row u and sample v where p - o = u * row half step + v * sample half step.
        row_x_ = view_.half_step[0][1], row_y_ = view_.half_step[1][1];
        sample_x_ = view_.half_step[0][2], sample_y_ = view_.half_step[1][2];
        area_ = Wide(row_x_) * sample_y_ - Wide(row_y_) * sample_x_;
        if (area_ > 0) {
            rows_.set_slopes(sample_y_, -sample_x_, area_);
            samples_.set_slopes(-row_y_, row_x_, area_);
        } else if (area_ < 0) {
            rows_.set_slopes(-sample_y_, sample_x_, -area_);
            samples_.set_slopes(row_y_, -row_x_, -area_);
        }
        samples_.set_blocks(block_start(view_.axes[2], 0), view_.axes[2].stride);
        const double dx = static_cast<double>(sample_x_), dy = static_cast<double>(sample_y_);
        const double square = dx * dx + dy * dy;
        along_x_ = dx / square / 2, along_y_ = dy / square / 2;
        half_sample_y_ = dy / 2;
    }

    // A sheet seen exactly edge on covers no pixel.
    bool empty() const { return area_ == 0; }

    // How far along an image row it is from one sample of a row to the next.
    double pixels_across() const { return pixels_apart(view_, 0, 2); }

    void enter_row(uint32_t sheet, uint32_t row) {
        int64_t low, high;
        block(view_.axes[0], ordinal(view_.axes[0], sheet), low, high);
        if (sheet != sheet_) {
            sheet_ = sheet;
            for (int c = 0; c < 2; ++c) origin_[c] = view_.origin[c] + (low + high - 1) * view_.half_step[c][0];
            rows_.enter_sheet(origin_[0], origin_[1], job_.image.width, job_.image.height);
            samples_.enter_sheet(origin_[0], origin_[1], job_.image.width, job_.image.height);
        }
        block(view_.axes[1], ordinal(view_.axes[1], row), low, high);
        u_low_ = 2 * low - 1, u_high_ = 2 * high - 1;
        middle_x_ = static_cast<double>(origin_[0] + (low + high - 1) * row_x_);
        middle_y_ = static_cast<double>(origin_[1] + (low + high - 1) * row_y_);
        half_rows_ = static_cast<double>(high - low) * size_of(static_cast<double>(row_y_));
        if (rows_.level()) image_rows_ = rows_.rows_between(u_low_, u_high_, {job_.row_begin, job_.row_end});
    }

    // The ordinal of the sample of this row that is nearest to a position in 1/64 pixel.
    int64_t ordinal_at(int64_t x64, int64_t y64) const {
        const double from_x = static_cast<double>(x64) * (kFixedOne / 64) - middle_x_;
        const double from_y = static_cast<double>(y64) * (kFixedOne / 64) - middle_y_;
        const double middle = from_x * along_x_ + from_y * along_y_;
        const AxisView& axis = view_.axes[2];
        // Within half a voxel of its middle a block belongs to one ordinal only, so rounding cannot matter.
        const double place =
            (middle + 0.5 - static_cast<double>(block_start(axis, 0))) / static_cast<double>(axis.stride);
        if (place >= static_cast<double>(axis.count)) return axis.count - 1;
        return place > 0 ? static_cast<int64_t>(place) : 0;
    }

    // The doubled bounds of the cells of some samples that follow each other.
    void bounds(int64_t least, int64_t greatest, int64_t& v_low, int64_t& v_high) const {
        int64_t low, high, unused;
        block(view_.axes[2], least, low, unused);
        block(view_.axes[2], greatest, unused, high);
        v_low = 2 * low - 1, v_high = 2 * high - 1;
    }

    // Whether `ordinals` can be asked for on this sheet.
    bool tells_ordinals() const { return samples_.tells_blocks(); }

    // Of eight pixels from (x, y) on the ordinals of the cells that they lie in, within these bounds.
    RowInts ordinals(int64_t x, int64_t y, int64_t least, int64_t greatest) const {
        return samples_.block_numbers(x, y, least, greatest);
    }

    // The image rows that cells of this row may touch, where a coordinate is level those that they do:
    // top <= y < bottom, within the job's.
    void image_rows(int64_t v_low, int64_t v_high, int64_t& top, int64_t& bottom) const {
        if (rows_.level() || samples_.level()) {
            const RowSpan rows = rows_.level() ? image_rows_
                                               : samples_.rows_between(v_low, v_high, {job_.row_begin, job_.row_end});
            top = rows.begin, bottom = rows.end;
            return;
        }
        const double middle = middle_y_ + static_cast<double>(v_low + v_high) * half_sample_y_;
        const double reach = half_rows_ + static_cast<double>(v_high - v_low) * size_of(half_sample_y_);
        constexpr double kSpare = 1.0 / 1024;  // pixels, for rounding
        const double least = (middle - reach) / kFixedOne - kSpare + 1;
        const double greatest = (middle + reach) / kFixedOne + kSpare + 1;
        top = least > job_.row_begin ? floor_of(least < job_.row_end ? least : job_.row_end) : job_.row_begin;
        bottom =
            greatest < job_.row_end ? floor_of(greatest > job_.row_begin ? greatest : job_.row_begin) : job_.row_end;
    }

    // The pixels of the image rows from `y` on that lie in cells of this row, where `image_rows` has these.
    RowSpans spans(int64_t y, int64_t v_low, int64_t v_high) const {
        RowSpans spans{RowInts{}, RowInts{} + job_.image.width};
        if (!rows_.level()) rows_.narrow(y, u_low_, u_high_, spans);
        if (!samples_.level()) samples_.narrow(y, v_low, v_high, spans);
        return spans;
    }

private:
    static int64_t ordinal(const AxisView& axis, uint32_t visited) {
        return axis.ascending ? int64_t(visited) : axis.count - 1 - int64_t(visited);
    }

    // Where the block of an ordinal begins, but for the outermost ones, which reach to the bounds.
    static int64_t block_start(const AxisView& axis, int64_t o) {
        return axis.first + axis.stride * o - axis.stride / 2;
    }

    static void block(const AxisView& axis, int64_t o, int64_t& low, int64_t& high) {
        const int64_t start = block_start(axis, o);
        low = o == 0 ? axis.low : start;
        high = o == axis.count - 1 ? axis.high : start + axis.stride;
    }

    const SplatJob& job_;
    const CellView& view_;
    CellCoordinate rows_, samples_;
    int64_t row_x_, row_y_, sample_x_, sample_y_;
    Wide area_;
    double along_x_, along_y_;  // doubled samples for 2^-32 pixel
    uint32_t sheet_ = ~uint32_t(0);
    int64_t origin_[2] = {0, 0};  // of the sheet
    double middle_x_ = 0, middle_y_ = 0;  // of the row of samples, where v is 0
    double half_rows_ = 0;  // how far its cells reach up and down from there
    RowSpan image_rows_{0, 0};  // that its cells lie in, where its coordinate is level
    double half_sample_y_;
    int64_t u_low_ = 0, u_high_ = 0;
};

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
