// The footprint table of a view: weights for every fractional offset of a sample's projection (paper: "Combining").
#pragma once

#include <cstdint>
#include <tuple>
#include <vector>

#include "footprint_box.h"
#include "kernel_projection.h"
#include "kernels/large_memory.h"
#include "splat_job.h"

namespace volsplat {

struct Ellipse {
    double amplitude, qxx, qxy, qyy;  // weight = amplitude * P(sqrt(qxx x^2 + 2 qxy x y + qyy y^2)), in pixels
    double half_width, half_height;   // of its bounding box, in pixels
};

class FootprintTable {
public:
    // 2^offset_bits offsets a pixel on each axis, 0..6, by so many threads. Throws std::invalid_argument for numbers
    // that make no table.
    FootprintTable(const KernelProjection& projection, const Ellipse& ellipse, int offset_bits, int threads);

    // The bytes of such a table's weights, to choose the offsets by.
    static double bytes_needed(const Ellipse& ellipse, int offset_bits);

    FootprintView view() const;
    // The box of offset (fx, fy) / 2^offset_bits: left, top in pixels from the sample's pixel, then its weights by
    // rows. Throws std::invalid_argument for offsets outside the table.
    std::tuple<int, int, std::vector<float>> weights_at(int fx, int fy) const;
    int offset_bits() const { return offset_bits_; }
    int width() const { return width_; }
    int height() const { return height_; }
    std::size_t bytes() const { return weight_count_ * sizeof(float); }

private:
    // Where the box begins for each offset: at `first`, from offset `step` on one pixel later.
    struct Starts {
        Starts(double half_extent, int offsets);
        std::vector<std::int32_t> at;
        int step;
    };

    float* weights() const { return memory_.get() + kWeightMargin; }
    int rows_of_band() const;
    // Of each weight of a band its pixel's number from the left; far away for padding.
    std::vector<float> columns_of_band() const;
    void fill(const FootprintBox& box, const Ellipse& ellipse, int threads);
    // The boxes of a row of offsets; their first rows of pixels lie at y = `top` from the sample.
    void fill_row(const FootprintBox& box, const Ellipse& ellipse, float top, float* row) const;
    std::vector<RowSpan> spans_of(const float* boxes, std::size_t count) const;

    int offset_bits_, width_, height_, pitch_;
    bool clamped_;
    Starts start_x_, start_y_;
    std::size_t weight_count_;
    LargeArray<float> memory_;
    std::vector<RowSpan> spans_;
};

}  // namespace volsplat
