// Splats footprints: decode some packets, then for each find its box of pixels and their weights, and combine.
#pragma once
#include "closed_tiles.h"
#include "pixel_vectors.h"
#include "shaded_sample.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

// Some samples at once: where they go, and what.
struct Samples {
    Integers left, top;      // pixels of the footprint's box
    Integers entry;          // its first weight in the table
    Integers inside;         // all bits where the box and its tiles lie within the image
    Integers tile_place, tile_shift;  // its first tile (see ClosedBoxes)
    Numbers opacity, red, green, blue;

    Point point(int n) const {
        return {all_lanes(opacity[n]), all_lanes(red[n]), all_lanes(green[n]), all_lanes(blue[n])};
    }
};

// kFours is how many times four pixels a row of the box takes; 0 where it is wider than kWideBox.
template <bool kFrontToBack, bool kClamped, int kFours>
class FootprintLoop {
public:
    explicit FootprintLoop(const SplatJob& job)
        : job_(job),
          table_(job.footprint),
          image_(job.image),
          closed_(job.image),
          closed_boxes_(job.image, table_.width, table_.height),
          least_top_(Integers{} + job.row_end),
          greatest_top_(Integers{} + job.row_begin - table_.height) {}

    SplatOutcome run() {
        size_t number = 0;
        for (size_t s = 0; s < job_.span_count; ++s) {
            const unsigned char* packets = job_.spans[s].packets;
            for (uint64_t r = 0; r < job_.spans[s].run_count; ++r) {
                const RowRun run = run_at(job_.spans[s].runs, r);
                if (in_rows(job_, number) && near(run)) {
                    const PacketRange range = within_rows(job_, number)
                                                  ? PacketRange{0, run.count}
                                                  : packets_in_rows(job_, run, packets, table_.height / 2 + 2);
                    splat_packets(run, packets + range.begin * 8, range.end - range.begin);
                }
                ++number;
                packets += uint64_t(run.count) * 8;
            }
        }
        return outcome();
    }

private:
    bool near(const RowRun& run) const {
        const int64_t left = (int64_t(run.x0) >> kSubpixelBits) - table_.width - 2;
        const int64_t top = (int64_t(run.y0) >> kSubpixelBits) - table_.height - 2;
        return left < image_.width && left + kRunPixels + 2 * (table_.width + 2) > 0 && top < job_.row_end &&
               top + kRunPixels + 2 * (table_.height + 2) > job_.row_begin;
    }

    void splat_packets(const RowRun& run, const unsigned char* packets, uint64_t total) {
        for (uint64_t done = 0; done < total; done += kAtOnce) {
            const uint64_t left = total - done;
            const Samples samples = decoded(packets_at(packets + done * 8, left), run);
            const int count = left < kAtOnce ? static_cast<int>(left) : kAtOnce;
            for (int n = 0; n < count; ++n) {
                if (kFours <= kFetchedFours && n + 1 < count) fetch_weights(samples.entry[n + 1]);
                if (kFours > 0 && samples.inside[n])
                    splat_inside(samples, n);
                else
                    splat_clipped(samples, n);
            }
        }
    }

    Samples decoded(const Packets& packets, const RowRun& run) {
        const int bits = table_.offset_bits, shift = kSubpixelBits - bits, half = 1 << shift >> 1;
        const Integers x = (packets.x() + (run.x0 + half)) >> shift, y = (packets.y() + (run.y0 + half)) >> shift;
        const Integers fx = x & ((1 << bits) - 1), fy = y & ((1 << bits) - 1);
        Samples samples;
        samples.left = (x >> bits) + table_.start_x - (fx >= table_.step_x);
        samples.top = (y >> bits) + table_.start_y - (fy >= table_.step_y);
        samples.entry = ((fy << bits) + fx) * (table_.pitch * table_.height);
        const int last_left = image_.width - kTileSide * closed_boxes_.columns;
        const int last_top = image_.height - kTileSide * closed_boxes_.rows;
        samples.inside = (samples.left >= 0) & (samples.left <= last_left) & (samples.top >= 0) &
                         (samples.top <= last_top);
        samples.tile_place = (samples.top >> 2) * closed_boxes_.row_bytes + (samples.left >> 5);
        samples.tile_shift = samples.left >> 2 & 7;
        samples.opacity = packets.opacity();
        samples.red = packets.red(), samples.green = packets.green(), samples.blue = packets.blue();
        least_top_ = samples.top < least_top_ ? samples.top : least_top_;
        greatest_top_ = samples.top > greatest_top_ ? samples.top : greatest_top_;
        return samples;
    }

    void splat_inside(const Samples& samples, int n) {
        const int left = samples.left[n], top = samples.top[n];
        const int y_begin = top > job_.row_begin ? top : job_.row_begin;
        const int y_end = top + table_.height < job_.row_end ? top + table_.height : job_.row_end;
        if (y_begin >= y_end) return;
        // Tiles of the neighbouring stripes may be closing meanwhile: that costs time, never bits.
        if (kFrontToBack && closed_boxes_.hide(samples.tile_place[n], samples.tile_shift[n])) {
            hidden_ += y_begin == top;
            return;
        }
        const int ahead = pixels_ahead(left);
        const float* weights = table_.weights + samples.entry[n] + int64_t(y_begin - top) * table_.pitch;
        const bool changed =
            combine_box({pixel(left - ahead, y_begin), weights - ahead, y_begin - top, y_end - top, ahead},
                        samples.point(n));
        if (kFrontToBack && !changed) closed_.examine({left, left + table_.width, y_begin, y_end});
    }

    // At the rim of the image.
    __attribute__((noinline)) void splat_clipped(const Samples& samples, int n) {
        const int left = samples.left[n], top = samples.top[n];
        const PixelBox box = {left > 0 ? left : 0,
                              left + table_.width < image_.width ? left + table_.width : image_.width,
                              top > job_.row_begin ? top : job_.row_begin,
                              top + table_.height < job_.row_end ? top + table_.height : job_.row_end};
        if (box.y_begin >= box.y_end || box.x_begin >= box.x_end) return;
        if (kFrontToBack && closed_.hide(box)) {
            hidden_ += box.y_begin == (top > 0 ? top : 0);
            return;
        }
        const float* weights = table_.weights + samples.entry[n] + int64_t(box.y_begin - top) * table_.pitch;
        const Point point = samples.point(n);
        const int ahead = pixels_ahead(left);
        const bool changed =
            kFours > 0 ? combine_box({pixel(left - ahead, box.y_begin), weights - ahead, box.y_begin - top,
                                      box.y_end - top, ahead}, point)
                       : combine_rows(left, top, box, weights, point);
        if (kFrontToBack && !changed) closed_.examine(box);
    }

    static constexpr int kFetchedFours = 2;

    // Asks for a small box's weights ahead of time: the table lies in the second cache.
    void fetch_weights(int entry) const {
        const float* const begin = table_.weights + entry;
        for (int n = 0, end = 4 * kFours * table_.height; n < end; n += 16) __builtin_prefetch(begin + n);
    }

    // How many pixels before its own first one the rows of a box begin.
    static int pixels_ahead(int left) { return 4 * kFours > kNarrowBox ? left & (kWidePixels - 1) : 0; }

    float* pixel(int x, int y) const { return image_.pixels + y * image_.pitch + x; }

    template <class Lanes>
    void combine_at(float* pixels, const float* weights, const Point& point, Added& added) const {
        combine<kFrontToBack, kClamped, Lanes>(pixels, image_.plane, weights, point, added);
    }

    struct Rows {
        float* pixels;
        const float* weights;
        int begin, end;  // of the footprint's rows
        int ahead;       // pixels before the footprint's own first one
    };

    // Rows as long for every sample, so that hardly a branch is mispredicted. Says whether alpha changed.
    __attribute__((always_inline)) bool combine_box(Rows rows, const Point& point) const {
        Added added{};
        if constexpr (4 * kFours > kNarrowBox) {
            for (; rows.begin < rows.end; ++rows.begin) combine_trimmed_row(rows, point, added);
        } else {
            for (; rows.end - rows.begin >= 4; rows.begin += 4)
#pragma GCC unroll 4
                for (int row = 0; row < 4; ++row) combine_whole_row(rows, point, added);
            for (; rows.begin < rows.end; ++rows.begin) combine_whole_row(rows, point, added);
        }
        return added.any_at_all();
    }

    __attribute__((always_inline)) void combine_whole_row(Rows& rows, const Point& point, Added& added) const {
        int x = 0;
#pragma GCC unroll 8
        for (; x + kWidest <= 4 * kFours; x += kWidest)
            combine_at<Widest>(rows.pixels + x, rows.weights + x, point, added);
        if (x < 4 * kFours) combine_at<Four>(rows.pixels + x, rows.weights + x, point, added);
        rows.pixels += image_.pitch, rows.weights += 4 * kFours;
    }

    // Without the corners of the box that the footprint never reaches.
    __attribute__((always_inline)) void combine_trimmed_row(Rows& rows, const Point& point, Added& added) const {
        const RowSpan span = table_.spans[rows.begin];
        for (int x = (rows.ahead + span.begin) & -kWidest; x < rows.ahead + span.end; x += kWidest)
            combine_at<Widest>(rows.pixels + x, rows.weights + x, point, added);
        rows.pixels += image_.pitch, rows.weights += 4 * kFours;
    }

    // Of each row what the footprint reaches.
    bool combine_rows(int left, int top, const PixelBox& box, const float* weights, const Point& point) const {
        Added added{};
        for (int y = box.y_begin; y < box.y_end; ++y, weights += table_.pitch) {
            const RowSpan span = table_.spans[y - top];
            int x = (box.x_begin - left > span.begin ? box.x_begin - left : span.begin) & -4;
            const int end = box.x_end - left < span.end ? box.x_end - left : span.end;
            for (; end - x > kWidest - 4; x += kWidest)
                combine_at<Widest>(pixel(left + x, y), weights + x, point, added);
            for (; x < end; x += 4) combine_at<Four>(pixel(left + x, y), weights + x, point, added);
        }
        return added.any_at_all();
    }

    SplatOutcome outcome() const {
        SplatOutcome outcome{job_.row_end, job_.row_begin, hidden_};
        for (int n = 0; n < kAtOnce; ++n) {
            const int begin = least_top_[n], end = greatest_top_[n] + table_.height;
            if (begin < outcome.row_begin) outcome.row_begin = begin > job_.row_begin ? begin : job_.row_begin;
            if (end > outcome.row_end) outcome.row_end = end < job_.row_end ? end : job_.row_end;
        }
        return outcome;
    }

    const SplatJob& job_;
    const FootprintView table_;
    const ImageView image_;
    const ClosedTiles closed_;
    const ClosedBoxes closed_boxes_;
    Integers least_top_, greatest_top_;
    uint64_t hidden_ = 0;
};

template <bool kFrontToBack, bool kClamped>
SplatOutcome splat_footprints(const SplatJob& job) {
    if (job.footprint.width > kWideBox) return FootprintLoop<kFrontToBack, kClamped, 0>(job).run();
    switch (job.footprint.pitch) {
        case 4: return FootprintLoop<kFrontToBack, kClamped, 1>(job).run();
        case 8: return FootprintLoop<kFrontToBack, kClamped, 2>(job).run();
        case 12: return FootprintLoop<kFrontToBack, kClamped, 3>(job).run();
        case 16: return FootprintLoop<kFrontToBack, kClamped, 4>(job).run();
        case 24: return FootprintLoop<kFrontToBack, kClamped, 6>(job).run();
        case 32: return FootprintLoop<kFrontToBack, kClamped, 8>(job).run();
        default: return FootprintLoop<kFrontToBack, kClamped, 10>(job).run();
    }
}

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
