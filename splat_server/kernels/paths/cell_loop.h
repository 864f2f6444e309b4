// Splats cells: of each row of the image that a cell touches the pixels inside. Narrow cells of samples that follow
// each other in a row are painted together, each of their pixels with the sample in whose cell it lies.
#pragma once
#include "../four_by_four.h"
#include "pixel_vectors.h"
#include "shaded_sample.h"
#include "sheet_cells.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

template <bool kFrontToBack>
class CellLoop {
public:
    explicit CellLoop(const SplatJob& job)
        : job_(job),
          cells_(job),
          way_(job.cell.axes[2].ascending ? 1 : -1),
          most_together_(cells_.pixels_across() < kWideCell ? kMostTogether : 1) {}

    void run() {
        if (cells_.empty()) return;
        for (size_t s = 0; s < job_.span_count; ++s) {
            const unsigned char* packets = job_.spans[s].packets;
            for (uint64_t r = 0; r < job_.spans[s].run_count; ++r) {
                const RowRun run = run_at(job_.image, job_.spans[s].runs, r);
                splat_run(run, packets);
                packets += uint64_t(run.count) * kPacketBytes;
            }
        }
    }

private:
    static constexpr int kMostTogether = 64;  // which fit into the first cache many times
    static constexpr int kWideCell = 6;       // pixels: from here on a cell alone keeps a vector busy
    static constexpr int kPixels = kSpanRows;  // at once
    typedef typename Fitting<kPixels>::Lanes Lanes;
    static constexpr int kLanes = sizeof(Lanes) / sizeof(float);

    void splat_run(const RowRun& run, const unsigned char* packets) {
        cells_.enter_row(run.sheet, run.row);
        const int most_together = cells_.tells_ordinals() ? most_together_ : 1;
        for (uint32_t n = 0; n < run.count; ++n, packets += kPacketBytes) {
            const ShadedSample sample = sample_at(packets, run, job_);
            const int64_t ordinal = cells_.ordinal_at(sample.x, sample.y);
            if (count_ == most_together || ordinal != first_ + way_ * count_) {
                paint_together();
                first_ = ordinal;
            }
            samples_[count_++] = Four{sample.opacity, sample.red, sample.green, sample.blue};
        }
        paint_together();
    }

    void paint_together() {
        if (count_ == 0) return;
        const int64_t last = first_ + way_ * (count_ - 1);
        const int64_t least = way_ > 0 ? first_ : last, greatest = way_ > 0 ? last : first_;
        int64_t v_low, v_high, top, bottom;
        cells_.bounds(least, greatest, v_low, v_high);
        cells_.image_rows(v_low, v_high, top, bottom);
        for (; top < bottom; top += kSpanRows) {
            const RowSpans spans = cells_.spans(top, v_low, v_high);
            const int rows = bottom - top < kSpanRows ? static_cast<int>(bottom - top) : kSpanRows;
            for (int n = 0; n < rows; ++n) {
                if (count_ == 1) paint_one(top + n, spans.begin[n], spans.end[n]);
                else paint(top + n, spans.begin[n], spans.end[n], least, greatest);
            }
        }
        count_ = 0;
    }

    // Weight 1 on the pixels x..x_end of a row; what is written beyond them stays as it was.
    void paint_one(int64_t y, int x, int x_end) {
        const Four& sample = samples_[0];
        const Point<Widest> point = in_all_lanes<Widest>(sample[0], sample[1], sample[2], sample[3]);
        float* pixels = pixel(x, y);
        for (; x < x_end; x += kWidest, pixels += kWidest)
            combine<kFrontToBack, false, Widest>(pixels, job_.image.plane, ones<kWidest>(x_end - x), point);
    }

    void paint(int64_t y, int x, int x_end, int64_t least, int64_t greatest) {
        const int64_t plane = job_.image.plane;
        float* pixels = pixel(x, y);
        for (; x < x_end; x += kPixels, pixels += kPixels) {
            const RowInts nth = way_ * (cells_.ordinals(x, y, least, greatest) - static_cast<int32_t>(first_));
            int32_t places[kPixels];
            __builtin_memcpy(places, &nth, sizeof places);
            const float* const weights = ones<kPixels>(x_end - x);
            for (int n = 0; n < kPixels; n += kLanes)
                combine<kFrontToBack, false, Lanes>(pixels + n, plane, weights + n, points_at(places + n));
        }
    }

    float* pixel(int64_t x, int64_t y) const { return job_.image.pixels + y * job_.image.pitch + x; }

    // Of so many weights the first `count` are 1, the others 0.
    template <int kMost>
    static const float* ones(int count) {
        return kOnesAndZeros + kOnes - (count < kMost ? count : kMost);
    }

    // The samples of as many pixels as there are lanes.
    Point<Lanes> points_at(const int32_t* places) const {
        Four channels[4][kLanes / 4];  // opacity, red, green, blue
        for (int part = 0; part < kLanes / 4; ++part, places += 4) {
            Four turned[4] = {samples_[places[0]], samples_[places[1]], samples_[places[2]], samples_[places[3]]};
            transpose(turned);
            for (int channel = 0; channel < 4; ++channel) channels[channel][part] = turned[channel];
        }
        Point<Lanes> points;
        __builtin_memcpy(&points, channels, sizeof points);
        return points;
    }

    static constexpr int kOnes = 16;
    static constexpr float kOnesAndZeros[2 * kOnes] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
    static_assert(kWidest <= kOnes && kPixels <= kOnes);

    const SplatJob& job_;
    SheetCells cells_;
    const int way_;  // from one sample's ordinal to the next one's
    const int most_together_;
    int64_t first_ = 0;
    int count_ = 0;
    Four samples_[kMostTogether];  // opacity, red, green, blue
};

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
