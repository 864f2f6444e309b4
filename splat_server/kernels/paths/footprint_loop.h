// Splats footprints: decode some packets, then for each find its box of pixels and their weights, and combine.
#pragma once
#include "closed_tiles.h"
#include "pixel_group.h"
#include "shaded_sample.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

// Some samples at once: where they go, and what.
struct Samples {
    Integers left, top;      // pixels of the footprint's box
    Integers entry;          // its first weight in the table
    Integers inside;         // all bits where the box and its tiles lie within the rows and columns to be written
    Integers group;          // that of the box's first pixel, counted from the image's first
    Integers alignment;      // of the box's first pixel in that group
    Integers tile_place, tile_shift;  // its first tile (see ClosedBoxes)
    Numbers opacity, red, green, blue;

    Point point(int n) const {
        return {all_lanes(opacity[n]), all_lanes(red[n]), all_lanes(green[n]), all_lanes(blue[n])};
    }
};

// kGroups is how many groups a row of a box takes at most; 0 where these are more than kMostBoxGroups.
template <bool kFrontToBack, bool kClamped, int kGroups>
class FootprintLoop {
public:
    explicit FootprintLoop(const SplatJob& job)
        : job_(job),
          table_(job.footprint),
          image_(job.image),
          closed_(job.image),
          closed_boxes_(job.image, table_.width, table_.height),
          least_top_(Integers{} + job.row_end),
          greatest_top_(Integers{} + job.row_begin - table_.height) {
        for (int alignment = 0; alignment < kGroupPixels; ++alignment)
            set_masks(masks_[alignment], alignment, table_.width);
    }

    SplatOutcome run() {
        size_t number = 0;
        for (size_t s = 0; s < job_.span_count; ++s) {
            const unsigned char* packets = job_.spans[s].packets;
            for (uint64_t r = 0; r < job_.spans[s].run_count; ++r) {
                const RowRun run = run_at(job_.spans[s].runs, r);
                if (in_rows(job_, number++) && near(run)) splat_run(run, packets);
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

    void splat_run(const RowRun& run, const unsigned char* packets) {
        for (uint64_t done = 0; done < run.count; done += kAtOnce) {
            const uint64_t left = run.count - done;
            const Samples samples = decoded(packets_at(packets + done * 8, left), run);
            const int count = left < kAtOnce ? static_cast<int>(left) : kAtOnce;
            for (int n = 0; n < count; ++n) {
                if (kGroups > 0 && samples.inside[n])
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
        samples.entry = ((fy << bits) + fx) * (table_.width * table_.height);
        const int last_left = image_.width - kTileSide * closed_boxes_.columns;
        const int last_top = job_.row_end - kTileSide * closed_boxes_.rows;
        samples.inside = (samples.left >= 0) & (samples.left <= last_left) & (samples.top >= job_.row_begin) &
                         (samples.top <= last_top);
        samples.group = samples.top * static_cast<int>(image_.pitch / kGroupFloats) + (samples.left >> 3);
        samples.alignment = samples.left & (kGroupPixels - 1);
        samples.tile_place = (samples.top >> 2) * closed_boxes_.row_bytes + (samples.left >> 5);
        samples.tile_shift = samples.left >> 2 & 7;
        samples.opacity = packets.opacity();
        samples.red = packets.red(), samples.green = packets.green(), samples.blue = packets.blue();
        least_top_ = samples.top < least_top_ ? samples.top : least_top_;
        greatest_top_ = samples.top > greatest_top_ ? samples.top : greatest_top_;
        return samples;
    }

    void splat_inside(const Samples& samples, int n) {
        if (kFrontToBack && closed_boxes_.hide(samples.tile_place[n], samples.tile_shift[n])) {
            ++hidden_;
            return;
        }
        const int alignment = samples.alignment[n];
        const bool changed = combine_box(image_.groups + int64_t(samples.group[n]) * kGroupFloats,
                                         table_.weights + (samples.entry[n] - alignment), table_.height,
                                         masks_[alignment], samples.point(n));
        if (kFrontToBack && !changed) {
            const int left = samples.left[n], top = samples.top[n];
            closed_.examine({left, left + table_.width, top, top + table_.height});
        }
    }

    // At the rim of the image or of the rows.
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
        const float* weights = table_.weights + samples.entry[n] + int64_t(box.y_begin - top) * table_.width;
        bool changed;
        if constexpr (kGroups > 0) {
            const int first = left & -kGroupPixels;
            Masks masks;
            set_masks(masks, box.x_begin - first, box.x_end - box.x_begin);
            changed = combine_box(image_.groups + box.y_begin * image_.pitch + int64_t(first) * 4,
                                  weights - (left - first), box.y_end - box.y_begin, masks, samples.point(n));
        } else {
            changed = combine_rows(left, top, box, weights, samples.point(n));
        }
        if (kFrontToBack && !changed) closed_.examine(box);
    }

    typedef PixelMask Masks[kGroups > 0 ? kGroups : 1];

    static void set_masks(Masks& masks, int begin, int count) {
        const uint64_t reached = ((uint64_t(1) << (count & 63)) - 1) << begin;
        for (int g = 0; g < kGroups; ++g) masks[g] = pixel_mask(reached >> (g * kGroupPixels));
    }

    // As many groups in each row of every sample, so that no branch is mispredicted. Says whether alpha changed.
    bool combine_box(float* pixels, const float* weights, int rows, const Masks& masks, const Point& point) const {
        LaneBits added{};
        const auto combine_row = [&] {
#pragma GCC unroll 8
            for (int g = 0; g < kGroups; ++g)
#pragma GCC unroll 2
                for (int part = 0; part < kParts; ++part)
                    combine<kFrontToBack, kClamped>(
                        pixels + g * kGroupFloats + part * kLanes,
                        load_within(weights + g * kGroupPixels + part * kLanes, masks[g], part), point, added);
            pixels += image_.pitch, weights += table_.width;
        };
        for (; rows >= 4; rows -= 4)
#pragma GCC unroll 4
            for (int row = 0; row < 4; ++row) combine_row();
        for (; rows > 0; --rows) combine_row();
        return any(added);
    }

    // Of each row the groups that the footprint reaches.
    bool combine_rows(int left, int top, const PixelBox& box, const float* weights, const Point& point) const {
        LaneBits added{};
        for (int y = box.y_begin; y < box.y_end; ++y, weights += table_.width) {
            const RowSpan span = table_.spans[y - top];
            int x = left + span.begin > 0 ? left + span.begin : 0;
            const int x_end = left + span.end < image_.width ? left + span.end : image_.width;
            float* const row = image_.groups + y * image_.pitch;
            while (x < x_end) {
                const int first = x & -kGroupPixels, end = x_end - first;
                const PixelMask mask = pixel_mask((end < kGroupPixels ? (1u << end) - 1 : 255u) & 255u << (x - first));
                for (int part = 0; part < kParts; ++part)
                    combine<kFrontToBack, kClamped>(
                        row + int64_t(first) * 4 + part * kLanes,
                        load_within(weights + (first - left) + part * kLanes, mask, part), point, added);
                x = first + kGroupPixels;
            }
        }
        return any(added);
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
    Masks masks_[kGroupPixels];  // of a box by its alignment
    Integers least_top_, greatest_top_;
    uint64_t hidden_ = 0;
};

template <bool kFrontToBack, bool kClamped>
SplatOutcome splat_footprints(const SplatJob& job) {
    switch ((job.footprint.width + kGroupPixels - 2) / kGroupPixels + 1) {
        case 1: return FootprintLoop<kFrontToBack, kClamped, 1>(job).run();
        case 2: return FootprintLoop<kFrontToBack, kClamped, 2>(job).run();
        case 3: return FootprintLoop<kFrontToBack, kClamped, 3>(job).run();
        case 4: return FootprintLoop<kFrontToBack, kClamped, 4>(job).run();
        case 5: return FootprintLoop<kFrontToBack, kClamped, 5>(job).run();
        default: return FootprintLoop<kFrontToBack, kClamped, 0>(job).run();
    }
}

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
