// Splats footprints: decode some packets, then for each find its box of pixels and their weights, and combine.
#pragma once

#include "closed_tiles.h"
#include "joined_boxes.h"
#include "kernels/compiler.h"
#include "pixel_vectors.h"
#include "shaded_sample.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

// Some samples at once: where they go, and what.
struct Samples {
    Integers left, top;  // pixels of the footprint's box
    Integers entry;      // its first weight in the table
    Integers whole;      // all bits where the box and its tiles lie within the image, and the box in the job's rows
    Integers window;     // of a few neighbours the lesser `left` of the first and the last, as they lie on a line
    Integers together;   // all bits where the box shares its rows with the first of them, and lies in the window
    Numbers opacity, red, green, blue;
};

// kFours is how many times four pixels a row of the box takes; 0 where it is wider than kWideBox.
template <bool kFrontToBack, bool kClamped, int kFours>
class FootprintLoop {
public:
    explicit FootprintLoop(const SplatJob& job)
        : job_(job),
          table_(job.footprint),
          image_(job.image),
          closed_(job.image, job.frozen_alpha),
          closed_boxes_(job.image, table_.width, table_.height),
          closed_windows_(job.image, Together::kWindow, table_.height),
          worth_looking_(std::int64_t(kWorthLooking) * job.image.width * (job.row_end - job.row_begin)),
          least_top_(Integers{} + job.row_end),
          greatest_top_(Integers{} + job.row_begin - table_.height),
          unseen_pixels_(job.unseen_pixels) {}

    SplatOutcome run() {
        for (std::size_t s = 0; s < job_.span_count; ++s) {
            const SpanView& span = job_.spans[s];
            const unsigned char* packets = span.packets;
            for (std::uint64_t r = 0; r < span.run_count; ++r) {
                const RowRun run = run_at(span.runs, r);
                if (near(run)) {
                    count_work(job_, run, packets);
                    splat_packets(run, packets, run.count);
                    unseen_pixels_ += std::int64_t(run.count) * table_.width * table_.height;
                    if (kFrontToBack && unseen_pixels_ >= worth_looking_) look_for_closed_tiles();
                }
                packets += std::uint64_t(run.count) * kPacketBytes;
            }
        }
        if (kFrontToBack && unseen_pixels_ >= worth_looking_ / 4) look_for_closed_tiles();  // for the next job
        return outcome();
    }

private:
    typedef typename Fitting<4 * kFours>::Lanes Lanes;
    typedef JoinedBoxes<kFrontToBack, kClamped, 4 * kFours> Together;
    // For so many times the pixels of the job's rows it is worth to look for tiles that have become closed: that takes
    // a hundredth of the time.
    static constexpr int kWorthLooking = 4;
    static constexpr int kLanes = sizeof(Lanes) / sizeof(float);

    bool near(const RowRun& run) const {
        const std::int64_t left = (std::int64_t(run.x0) >> kSubpixelBits) - table_.width - 2;
        const std::int64_t top = (std::int64_t(run.y0) >> kSubpixelBits) - table_.height - 2;
        return left < image_.width && left + kRunPixels + 2 * (table_.width + 2) > 0 && top < job_.row_end &&
               top + kRunPixels + 2 * (table_.height + 2) > job_.row_begin;
    }

    void splat_packets(const RowRun& run, const unsigned char* packets, std::uint64_t count) {
        for (; count >= kAtOnce; count -= kAtOnce, packets += kAtOnce * kPacketBytes)
            splat_samples(decoded(packets_at(packets), run), kAtOnce);
        if (count == 0) return;
        const int last = static_cast<int>(count);
        splat_samples(decoded(last_packets_at(packets, last), run), last);
    }

    __attribute__((always_inline)) void splat_samples(const Samples& samples, int count) {
        int n = 0;
        if constexpr (Together::kFit) {
            for (; n + Together::kSamples <= count; n += Together::kSamples) {
                if (stand_together(samples, n)) splat_together(samples, n);
                else splat_each(samples, n, n + Together::kSamples);
            }
        }
        splat_each(samples, n, count);
    }

    __attribute__((always_inline)) void splat_each(const Samples& samples, int begin, int end) {
        for (int n = begin; n < end; ++n) {
            if (kFours > 0 && samples.whole[n]) splat_whole(samples, n);
            else splat_clipped(samples, n);
        }
    }

    Samples decoded(const Packets& packets, const RowRun& run) {
        const int bits = table_.offset_bits, shift = kSubpixelBits - bits;
        const int added = static_cast<int>(std::uint64_t(job_.thresholds.of(run.sheet)) << shift >> 32);
        const Integers x = (packets.x() + (run.x0 + added)) >> shift;
        const Integers y = (packets.y() + (run.y0 + added)) >> shift;
        const Integers fx = x & ((1 << bits) - 1), fy = y & ((1 << bits) - 1);
        Samples samples;
        samples.left = (x >> bits) + table_.start_x - (fx >= table_.step_x);
        samples.top = (y >> bits) + table_.start_y - (fy >= table_.step_y);
        samples.entry = ((fy << bits) + fx) * (table_.pitch * table_.height);
        const Integers inside = (samples.left >= 0) & (samples.left <= closed_boxes_.last_left) & (samples.top >= 0) &
                                (samples.top <= closed_boxes_.last_top);
        samples.whole = inside & (samples.top >= job_.row_begin) & (samples.top <= job_.row_end - table_.height);
        if constexpr (Together::kFit) find_together(samples);
        samples.opacity = packets.opacity();
        samples.red = packets.red(), samples.green = packets.green(), samples.blue = packets.blue();
        least_top_ = samples.top < least_top_ ? samples.top : least_top_;
        greatest_top_ = samples.top > greatest_top_ ? samples.top : greatest_top_;
        return samples;
    }

    void find_together(Samples& samples) const {
        const Integers at_first = first_of_neighbours(samples.left), at_last = last_of_neighbours(samples.left);
        samples.window = at_first < at_last ? at_first : at_last;
        samples.together = samples.whole & (samples.top == first_of_neighbours(samples.top)) &
                           (samples.left >= samples.window) &
                           (samples.left <= samples.window + (Together::kWindow - 4 * kFours)) &
                           (samples.window <= closed_windows_.last_left);
    }

    static Integers first_of_neighbours(Integers lanes) {
        if constexpr (Together::kSamples == 2) return __builtin_shufflevector(lanes, lanes, 0, 0, 2, 2, 4, 4, 6, 6);
        else return __builtin_shufflevector(lanes, lanes, 0, 0, 0, 0, 4, 4, 4, 4);
    }

    static Integers last_of_neighbours(Integers lanes) {
        if constexpr (Together::kSamples == 2) return __builtin_shufflevector(lanes, lanes, 1, 1, 3, 3, 5, 5, 7, 7);
        else return __builtin_shufflevector(lanes, lanes, 3, 3, 3, 3, 7, 7, 7, 7);
    }

    static bool stand_together(const Samples& samples, int n) {
        const std::int32_t* const together = reinterpret_cast<const std::int32_t*>(&samples.together) + n;
        if constexpr (Together::kSamples == 2) {
            return (together[0] & together[1]) != 0;
        } else {
            FourBits four;
            __builtin_memcpy(&four, together, sizeof four);
            return !any(~four);
        }
    }

    __attribute__((always_inline)) void splat_together(const Samples& samples, int n) {
        const int left = samples.window[n], top = samples.top[n];
        if (kFrontToBack && closed_windows_.hide(left, top)) {
            hidden_ += Together::kSamples;
            return;
        }
        Together boxes(job_.frozen_alpha);
        for (int k = 0; k < Together::kSamples; ++k) {
            const ShiftedBox box = {table_.weights + samples.entry[n + k], samples.left[n + k] - left};
            boxes.set(k, box, point_of<typename Together::Lanes>(samples, n + k));
        }
        boxes.combine_rows(pixel(left, top), image_.plane, image_.pitch, table_.height);
    }

    __attribute__((always_inline)) void splat_whole(const Samples& samples, int n) {
        const int left = samples.left[n], top = samples.top[n];
        if (kFrontToBack && closed_boxes_.hide(left, top)) {
            ++hidden_;
            return;
        }
        const float* const weights = table_.weights + samples.entry[n];
        combine_box(pixel(left, top), weights, {0, table_.height}, point_of<Lanes>(samples, n));
    }

    // At the rim of the image, or of the job's rows.
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
        const RowSpan rows = {box.y_begin - top, box.y_end - top};
        const float* const weights = table_.weights + samples.entry[n] + std::int64_t(rows.begin) * table_.pitch;
        const Point<Lanes> point = point_of<Lanes>(samples, n);
        if (kFours > 0) combine_box(pixel(left, box.y_begin), weights, rows, point);
        else combine_rows(left, top, box, weights, point);
    }

    template <class AllLanes>
    static Point<AllLanes> point_of(const Samples& samples, int n) {
        return in_all_lanes<AllLanes>(samples.opacity[n], samples.red[n], samples.green[n], samples.blue[n]);
    }

    __attribute__((noinline)) void look_for_closed_tiles() {
        unseen_pixels_ = 0;
        closed_.look(job_.row_begin, job_.row_end);
    }

    float* pixel(int x, int y) const { return image_.pixels + y * image_.pitch + x; }

    // Rows as long for every sample, so that hardly a branch is mispredicted.
    __attribute__((always_inline)) void combine_box(float* pixels, const float* weights, RowSpan rows,
                                                    const Point<Lanes>& point) const {
        const std::int64_t plane = image_.plane,
                           pitch = image_.pitch;  // kept in registers, whatever is written meanwhile
        const float frozen = job_.frozen_alpha;
        const auto combine_row = [&](int row) __attribute__((always_inline)) {
            if constexpr (4 * kFours > kNarrowBox)
                combine_reached(pixels, plane, weights, table_.spans[row], point, frozen);
            else combine_pixels<kFrontToBack, kClamped, 4 * kFours>(pixels, plane, weights, point, frozen);
            pixels += pitch, weights += 4 * kFours;
        };
        for (; rows.end - rows.begin >= 4; rows.begin += 4) VOLSPLAT_UNROLL(4)
        for (int row = 0; row < 4; ++row) combine_row(rows.begin + row);
        for (; rows.begin < rows.end; ++rows.begin) combine_row(rows.begin);
    }

    // Without the corners of the box that the footprint never reaches.
    __attribute__((always_inline)) static void combine_reached(float* pixels, std::int64_t plane, const float* weights,
                                                               RowSpan span, const Point<Lanes>& point, float frozen) {
        int vectors = (span.end - span.begin + kLanes - 1) / kLanes;
        const int last_begin = 4 * kFours - vectors * kLanes;
        for (int x = span.begin < last_begin ? span.begin : last_begin; vectors > 0; --vectors, x += kLanes)
            combine<kFrontToBack, kClamped, Lanes>(pixels + x, plane, weights + x, point, frozen);
    }

    // Of each row what the footprint reaches, within the image.
    void combine_rows(int left, int top, const PixelBox& box, const float* weights, const Point<Lanes>& point) const {
        const std::int64_t plane = image_.plane;
        const float frozen = job_.frozen_alpha;
        for (int y = box.y_begin; y < box.y_end; ++y, weights += table_.pitch) {
            const RowSpan span = table_.spans[y - top];
            int x = (box.x_begin - left > span.begin ? box.x_begin - left : span.begin) & -4;
            const int end = box.x_end - left < span.end ? box.x_end - left : span.end;
            float* const pixels = pixel(left, y);
            for (; end - x > kLanes - 4; x += kLanes)
                combine<kFrontToBack, kClamped, Lanes>(pixels + x, plane, weights + x, point, frozen);
            for (; x < end; x += 4)
                combine<kFrontToBack, kClamped, Four>(pixels + x, plane, weights + x, point, frozen);
        }
    }

    SplatOutcome outcome() const {
        SplatOutcome outcome{job_.row_end, job_.row_begin, hidden_, unseen_pixels_};
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
    const ClosedBoxes closed_boxes_, closed_windows_;
    const std::int64_t worth_looking_;
    Integers least_top_, greatest_top_;
    std::int64_t unseen_pixels_;
    std::uint64_t hidden_ = 0;
};

template <bool kFrontToBack, bool kClamped>
SplatOutcome splat_footprints(const SplatJob& job) {
    if (job.footprint.width > kWideBox) return FootprintLoop<kFrontToBack, kClamped, 0>(job).run();
    switch (job.footprint.pitch) {
        case 4:
            return FootprintLoop<kFrontToBack, kClamped, 1>(job).run();
        case 8:
            return FootprintLoop<kFrontToBack, kClamped, 2>(job).run();
        case 12:
            return FootprintLoop<kFrontToBack, kClamped, 3>(job).run();
        case 16:
            return FootprintLoop<kFrontToBack, kClamped, 4>(job).run();
        default:
            return FootprintLoop<kFrontToBack, kClamped, 8>(job).run();
    }
}

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
