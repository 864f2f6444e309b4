// Which pixel centres lie inside the samples' cells in their sheet (design, section 6: nearest pixel above one pixel a
// voxel). The cells of a sheet tile the image with no hole and no overlap: what floating point cannot tell for certain
// is decided in integers, from the indices.
//
// A ray is in up to three cells of a sheet, and each has a third of its path: that in which it enters the sheet, that
// in which it leaves it, and between them the one that shares a side with both, in the row where it leaves. From sheet
// to sheet it stays in its row and place. So whatever a ray passes through shares a side with what comes next, and a
// closed shell one voxel thin lets no ray through.
#pragma once

#include "cell_coordinate.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

// Pixels along one coordinate from a sample to the next on an axis.
inline double pixels_apart(const CellView& cells, int coordinate, int axis) {
    return size_of(static_cast<double>(cells.half_step[coordinate][axis])) * 2 *
           static_cast<double>(cells.axes[axis].visits.stride) / kFixedOne;
}

class SheetCells {
public:
    static constexpr int kThirds = 3;  // of a ray's path through a sheet (protocol/rules/frame_plan.py)

    explicit SheetCells(const SplatJob& job) : job_(job), view_(job.cell) {
        // A pixel centre p lies at doubled row u and sample v where p - o = u * row half step + v * sample half step.
        row_x_ = view_.half_step[0][1], row_y_ = view_.half_step[1][1];
        sample_x_ = view_.half_step[0][2], sample_y_ = view_.half_step[1][2];
        area_ = Wide(row_x_) * sample_y_ - Wide(row_y_) * sample_x_;
        const std::int64_t sign = area_ < 0 ? -1 : 1;
        for (int face = 0; face < kFaces && area_ != 0; ++face) {
            rows_at_[face].set_slopes(sign * sample_y_, -sign * sample_x_, area_ * sign);
            samples_at_[face].set_slopes(-sign * row_y_, sign * row_x_, area_ * sign);
            samples_at_[face].set_blocks(samples().block_start(0), samples().stride);
        }
        const std::int64_t sheet_x = view_.half_step[0][0], sheet_y = view_.half_step[1][0];
        row_aside_ = aside(Wide(sheet_x) * sample_y_ - Wide(sheet_y) * sample_x_, view_.axes[1]);
        sample_aside_ = aside(Wide(sheet_y) * row_x_ - Wide(sheet_x) * row_y_, view_.axes[2]);
        const double dx = static_cast<double>(sample_x_), dy = static_cast<double>(sample_y_);
        const double square = dx * dx + dy * dy;
        along_x_ = dx / square / 2, along_y_ = dy / square / 2;
        half_sample_y_ = dy / 2;
    }

    // A sheet seen exactly edge on covers no pixel.
    bool empty() const { return area_ == 0; }

    // How far along an image row it is from one sample of a row to the next.
    double pixels_across() const { return pixels_apart(view_, 0, 2); }

    void enter_row(std::uint32_t sheet, std::uint32_t row) {
        std::int64_t low, high;
        if (sheet != sheet_) enter_sheet(sheet);
        block(view_.axes[1].visits, ordinal(view_.axes[1], row), low, high);
        u_low_ = 2 * low - 1, u_high_ = 2 * high - 1;
        for (int c = 0; c < 2; ++c)
            middle_[c] = static_cast<double>(origin_[c] + (low + high - 1) * view_.half_step[c][1]);
        half_rows_ = static_cast<double>(high - low) * size_of(static_cast<double>(row_y_));
        if (rows_at_[0].level())
            for (int face = 0; face < kFaces; ++face)
                level_rows_[face] = rows_at_[face].rows_between(u_low_, u_high_, all_rows());
    }

    // The ordinal of the sample of this row that is nearest to a position in 1/64 pixel.
    std::int64_t ordinal_at(std::int64_t x64, std::int64_t y64) const {
        const double from_x = static_cast<double>(x64) * (kFixedOne / 64) - middle_[0];
        const double from_y = static_cast<double>(y64) * (kFixedOne / 64) - middle_[1];
        const double middle = from_x * along_x_ + from_y * along_y_;
        // Within half a voxel of its middle a block belongs to one ordinal only, so rounding cannot matter.
        const double place =
            (middle + 0.5 - static_cast<double>(samples().block_start(0))) / static_cast<double>(samples().stride);
        if (place >= static_cast<double>(samples().count)) return samples().count - 1;
        return place > 0 ? static_cast<std::int64_t>(place) : 0;
    }

    // Whether `ordinals` can be asked for on this sheet.
    bool tells_ordinals() const { return samples_at_[0].tells_blocks() && samples_at_[1].tells_blocks(); }

    // Of eight pixels from (x, y) on the ordinals of the cells that they lie in on a face, within these bounds.
    RowInts ordinals(int face, std::int64_t x, std::int64_t y, std::int64_t least, std::int64_t greatest) const {
        return samples_at_[face].block_numbers(x, y, least, greatest);
    }

    // Whether a ray keeps its place along the rows all through the sheet.
    bool keeps_samples() const { return sample_aside_ == 0; }

    // From now on it is about the cells of some samples of the row that follow each other. The image rows that they may
    // touch, within the job's.
    RowSpan enter_cells(std::int64_t least, std::int64_t greatest) {
        std::int64_t low, high, unused;
        block(samples(), least, low, unused);
        block(samples(), greatest, unused, high);
        v_low_ = 2 * low - 1, v_high_ = 2 * high - 1;
        if (!rows_at_[0].level() && !samples_at_[0].level()) return rows_around();
        if (samples_at_[0].level())
            for (int face = 0; face < kFaces; ++face)
                level_rows_[face] = samples_at_[face].rows_between(v_low_, v_high_, all_rows());
        const RowSpan &a = level_rows_[0], &b = level_rows_[1];
        if (a.begin >= a.end || b.begin >= b.end) return a.begin < a.end ? a : b;
        return {a.begin < b.begin ? a.begin : b.begin, a.end > b.end ? a.end : b.end};
    }

    // Of the image rows from `y` on the pixels whose rays are in these cells in each third of their way to the viewer.
    void spans(std::int64_t y, RowSpans (&thirds)[kThirds]) const {
        RowSpans in_row[kFaces], in_samples[kFaces];
        within(rows_at_, row_aside_, y, u_low_, u_high_, in_row);
        within(samples_at_, sample_aside_, y, v_low_, v_high_, in_samples);
        thirds[0] = common(in_row[0], in_samples[0]);
        thirds[1] = common(in_row[1], in_samples[0]);
        thirds[2] = common(in_row[1], in_samples[1]);
    }

private:
    static constexpr int kFaces = 2;  // of a sheet: away from the viewer, and towards the viewer

    RowSpan all_rows() const { return {job_.row_begin, job_.row_end}; }

    RowSpan rows_around() const {
        const double middle = middle_[1] + static_cast<double>(v_low_ + v_high_) * half_sample_y_;
        const double reach = half_rows_ + static_cast<double>(v_high_ - v_low_) * size_of(half_sample_y_) + aside_y_;
        constexpr double kSpare = 1.0 / 1024;  // pixels, for rounding
        const double least = (middle - reach) / kFixedOne - kSpare + 1;
        const double greatest = (middle + reach) / kFixedOne + kSpare + 1;
        const auto limited = [&](double row) {
            return static_cast<std::int32_t>(
                floor_of(row > job_.row_begin ? (row < job_.row_end ? row : job_.row_end) : job_.row_begin));
        };
        return {limited(least), limited(greatest)};
    }

    // Of the rows from `y` on the pixels with low <= coordinate < high on each face.
    void within(const CellCoordinate (&coordinate)[kFaces], double aside, std::int64_t y, std::int64_t low,
                std::int64_t high, RowSpans (&spans)[kFaces]) const {
        for (int face = 0; face < kFaces; ++face) {
            if (face > 0 && aside == 0) {
                spans[face] = spans[0];
                continue;
            }
            spans[face] = {RowInts{}, RowInts{} + job_.image.width};
            if (!coordinate[face].level()) {
                coordinate[face].narrow(y, low, high, spans[face]);
                continue;
            }
            const RowInts rows = RowInts{0, 1, 2, 3, 4, 5, 6, 7} + static_cast<std::int32_t>(y);
            spans[face].end &= (rows >= level_rows_[face].begin) & (rows < level_rows_[face].end);
        }
    }

    static RowSpans common(const RowSpans& a, const RowSpans& b) {
        return {a.begin > b.begin ? a.begin : b.begin, a.end < b.end ? a.end : b.end};
    }

    // How far along an axis of its own a sheet is shifted on the screen for each half voxel that it lies deeper; 0
    // where rounding alone shifts it against the order of traversal, for a pixel's samples must come in that order.
    double aside(Wide numerator, const CellAxis& axis) const {
        if (area_ < 0) numerator = -numerator;
        const bool rises = (numerator < 0) == view_.axes[0].ascending;  // in the order of the sheets
        if (numerator == 0 || rises != axis.ascending) return 0;
        return static_cast<double>(numerator) / static_cast<double>(area_ < 0 ? -area_ : area_);
    }

    void enter_sheet(std::uint32_t sheet) {
        sheet_ = sheet;
        std::int64_t low, high;
        block(view_.axes[0].visits, ordinal(view_.axes[0], sheet), low, high);
        const std::int64_t middle = low + high - 1;
        const bool far_is_low = view_.axes[0].ascending != job_.front_to_back;
        for (int face = 0; face < kFaces; ++face) {
            const std::int64_t away = (face == 0) == far_is_low ? low - high : high - low;
            const std::int64_t at_rows = middle + (row_aside_ == 0 ? 0 : away);
            const std::int64_t at_samples = middle + (sample_aside_ == 0 ? 0 : away);
            enter_face(rows_at_[face], at_rows);
            enter_face(samples_at_[face], at_samples);
        }
        for (int c = 0; c < 2; ++c) origin_[c] = view_.origin[c] + middle * view_.half_step[c][0];
        aside_y_ = static_cast<double>(high - low) * (size_of(row_aside_ * static_cast<double>(row_y_)) +
                                                      size_of(sample_aside_ * static_cast<double>(sample_y_)));
    }

    void enter_face(CellCoordinate& coordinate, std::int64_t doubled) const {
        coordinate.enter_sheet(view_.origin[0] + doubled * view_.half_step[0][0],
                               view_.origin[1] + doubled * view_.half_step[1][0], job_.image.width, job_.image.height);
    }

    const AxisVisits& samples() const { return view_.axes[2].visits; }

    static std::int64_t ordinal(const CellAxis& axis, std::uint32_t visited) {
        return axis.ascending ? std::int64_t(visited) : axis.visits.count - 1 - std::int64_t(visited);
    }

    static void block(const AxisVisits& visits, std::int64_t o, std::int64_t& low, std::int64_t& high) {
        low = visits.block_low(o), high = visits.block_high(o);
    }

    const SplatJob& job_;
    const CellView& view_;
    CellCoordinate rows_at_[kFaces], samples_at_[kFaces];
    std::int64_t row_x_, row_y_, sample_x_, sample_y_;
    Wide area_;
    double along_x_, along_y_;  // doubled samples for 2^-32 pixel
    double row_aside_, sample_aside_;
    std::uint32_t sheet_ = ~std::uint32_t(0);
    std::int64_t origin_[2] = {0, 0};                // of the sheet's middle
    double aside_y_ = 0;                             // how far up and down from there rays enter and leave it
    double middle_[2] = {0, 0};                      // of the row of samples, where v is 0
    double half_rows_ = 0;                           // how far its cells reach up and down from there
    RowSpan level_rows_[kFaces] = {{0, 0}, {0, 0}};  // that the cells lie in, where a coordinate is level
    double half_sample_y_;
    std::int64_t u_low_ = 0, u_high_ = 0, v_low_ = 0, v_high_ = 0;
};

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
