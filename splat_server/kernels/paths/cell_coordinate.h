// One coordinate of a sheet over the pixels: a fraction of integers that floating point tells in almost every place.
#pragma once

#include "pixel_vectors.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

typedef __int128 Wide;

constexpr double kFixedOne = 4294967296.0;  // 2^-32 pixel

inline std::int64_t floor_of(double value) {
    const auto truncated = static_cast<std::int64_t>(value);
    return truncated - (static_cast<double>(truncated) > value);
}

inline double size_of(double value) { return value < 0 ? -value : value; }

constexpr int kSpanRows = 8;
typedef std::int32_t RowInts __attribute__((vector_size(kSpanRows * 4)));
typedef std::int64_t RowBits __attribute__((vector_size(kSpanRows * 8)));
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
    void set_slopes(std::int64_t per_x, std::int64_t per_y, Wide area) {
        per_x_ = per_x, per_y_ = per_y, area_ = area;
        slope_x_ = static_cast<double>(per_x) * (kFixedOne / static_cast<double>(area));
        slope_y_ = static_cast<double>(per_y) * (kFixedOne / static_cast<double>(area));
        pixels_ = per_x == 0 ? 0 : 1 / slope_x_;
    }

    // For block_numbers: block n begins at the doubled coordinate 2 * (first + n * size) - 1.
    void set_blocks(std::int64_t first, std::int64_t size) {
        first_block_ = 2 * first - 1, block_size_ = 2 * size;
        blocks_per_unit_ = 1 / static_cast<double>(block_size_);
    }

    void enter_sheet(std::int64_t origin_x, std::int64_t origin_y, int width, int height) {
        at_zero_ = -Wide(origin_x) * per_x_ - Wide(origin_y) * per_y_;
        constant_ = static_cast<double>(at_zero_) / static_cast<double>(area_);
        width_ = width;
        constexpr double kRounding = 1.0 / (std::int64_t(1) << 47);  // of all that is added up, well above 2^-53
        const double greatest = size_of(constant_) + size_of(slope_x_) * width + size_of(slope_y_) * height;
        doubt_ = kRounding * (2 * greatest + 1) * size_of(pixels_);
        block_doubt_ = kRounding * (2 * greatest + size_of(static_cast<double>(first_block_)) + 1) * blocks_per_unit_;
    }

    // Whether floating point leaves no more than two neighbouring blocks in question, as block_numbers needs it.
    bool tells_blocks() const { return block_doubt_ < 0.5; }

    // Of eight pixels from (x, y) on the blocks that they lie in; of those beyond `least` or `greatest` these.
    RowInts block_numbers(std::int64_t x, std::int64_t y, std::int64_t least, std::int64_t greatest) const {
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
    RowSpan rows_between(std::int64_t low, std::int64_t high, RowSpan rows) const {
        const std::int32_t begin = first_row_beyond(per_y_ < 0 ? high : low, rows.begin, rows.end);
        return {begin, first_row_beyond(per_y_ < 0 ? low : high, begin, rows.end)};
    }

    // Narrows the spans of the rows from `y` on to the pixels with low <= coordinate < high, where it is not level.
    void narrow(std::int64_t y, std::int64_t low, std::int64_t high, RowSpans& spans) const {
        if (!narrow_if_certain(y, low, high, spans)) narrow_exactly(y, low, high, spans);
    }

private:
    // Leaves the spans alone and says no where a bound lies so near to a pixel's centre that rounding could decide.
    bool narrow_if_certain(std::int64_t y, std::int64_t low, std::int64_t high, RowSpans& spans) const {
        const RowReals down = {0, 1, 2, 3, 4, 5, 6, 7};
        const RowReals rows = constant_ + slope_y_ * (static_cast<double>(y) + down);
        RowBits doubtful{};
        // The first pixel beyond a bound; off the image any will do
        const auto first_beyond = [&](std::int64_t bound) {
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

    void narrow_exactly(std::int64_t y, std::int64_t low, std::int64_t high, RowSpans& spans) const {
        for (int n = 0; n < kSpanRows; ++n) {
            const std::int32_t begin = spans.begin[n], end = spans.end[n];
            if (begin >= end) continue;
            const std::int32_t from = first_beyond(per_x_ < 0 ? high : low, y + n, begin, end);
            spans.begin[n] = from;
            spans.end[n] = first_beyond(per_x_ < 0 ? low : high, y + n, from, end);
        }
    }

    Wide at(std::int64_t x, std::int64_t y) const {
        return at_zero_ + (Wide(x) << 32) * per_x_ + (Wide(y) << 32) * per_y_;
    }

    // The one of two neighbouring blocks, by the number of the second, that a pixel lies in.
    std::int32_t block_at(std::int64_t x, std::int64_t y, std::int32_t second) const {
        const std::int64_t bound = first_block_ + second * block_size_;
        return at(x, y) < bound * area_ ? second - 1 : second;
    }

    // The first pixel of begin..end where a rising coordinate is no longer below `bound`, a falling one is, or `end`.
    std::int32_t first_beyond(std::int64_t bound, std::int64_t y, std::int32_t begin, std::int32_t end) const {
        return first_of(begin, end, [&](std::int32_t x) {
            return per_x_ < 0 ? at(x, y) < bound * area_ : at(x, y) >= bound * area_;
        });
    }

    // The same of rows; floating point tells where to look.
    std::int32_t first_row_beyond(std::int64_t bound, std::int32_t begin, std::int32_t end) const {
        const auto is_beyond = [&](std::int32_t y) {
            return per_y_ < 0 ? at(0, y) < bound * area_ : at(0, y) >= bound * area_;
        };
        const double place = (static_cast<double>(bound) - constant_) / slope_y_;
        const std::int32_t near = place < begin ? begin : place > end ? end : static_cast<std::int32_t>(place);
        const std::int32_t low = near - 1 > begin ? near - 1 : begin, high = near + 2 < end ? near + 2 : end;
        if ((low > begin && is_beyond(low)) || (high < end && !is_beyond(high))) return first_of(begin, end, is_beyond);
        return first_of(low, high, is_beyond);
    }

    // The first of begin..end from which on something is true, or `end`.
    template <class IsTrue>
    static std::int32_t first_of(std::int32_t begin, std::int32_t end, const IsTrue& is_true) {
        while (begin < end) {
            const std::int32_t middle = begin + (end - begin) / 2;
            if (is_true(middle)) end = middle;
            else begin = middle + 1;
        }
        return begin;
    }

    std::int64_t per_x_ = 0, per_y_ = 0;
    Wide area_ = 1, at_zero_ = 0;
    double slope_x_ = 0, slope_y_ = 0, constant_ = 0;
    double pixels_ = 0;  // for which the coordinate changes by 1
    double doubt_ = 0;   // pixels: nearer than this to a pixel's centre a crossing must be decided in integers
    int width_ = 0;
    std::int64_t first_block_ = 0, block_size_ = 1;
    double blocks_per_unit_ = 1;
    double block_doubt_ = 0;  // blocks: nearer than this to its end a pixel's block must be decided in integers
};

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
