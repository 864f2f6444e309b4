// Splats cells: of each row of the image that a cell touches the pixels inside. Narrow cells of samples that follow
// each other in a row are painted together, each of their pixels with the sample in whose cell it lies.
#pragma once

#include "closed_tiles.h"
#include "pixel_vectors.h"
#include "shaded_sample.h"
#include "sheet_cells.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

template <bool kFrontToBack>
class CellLoop {
public:
    explicit CellLoop(const SplatJob& job)
        : job_(job),
          cells_(job),
          way_(job.cell.axes[2].ascending ? 1 : -1),
          most_together_(cells_.pixels_across() < kWideCell ? kMostTogether : 1),
          worth_looking_(std::int64_t(kWorthLooking) * job.image.width * (job.row_end - job.row_begin)),
          unseen_pixels_(job.unseen_pixels) {}

    SplatOutcome run() {
        const SplatOutcome outcome{job_.row_begin, job_.row_end, 0, 0};
        if (cells_.empty()) return outcome;
        for (std::size_t s = 0; s < job_.span_count; ++s) {
            const unsigned char* packets = job_.spans[s].packets;
            for (std::uint64_t r = 0; r < job_.spans[s].run_count; ++r) {
                const RowRun run = run_at(job_.spans[s].runs, r);
                count_work(job_, run, packets);
                splat_run(run, packets);
                packets += std::uint64_t(run.count) * kPacketBytes;
                if (kFrontToBack && unseen_pixels_ >= worth_looking_) look_for_closed_tiles();
            }
        }
        if (kFrontToBack && unseen_pixels_ >= worth_looking_ / 4) look_for_closed_tiles();  // for the next job
        return {job_.row_begin, job_.row_end, 0, unseen_pixels_};
    }

private:
    static constexpr int kMostTogether = 64;   // which fit into the first cache many times
    static constexpr int kWideCell = 6;        // pixels: from here on a cell alone keeps a vector busy
    static constexpr int kPixels = kSpanRows;  // at once
    static constexpr int kThirds = SheetCells::kThirds;
    // For so many times the pixels of the job's rows it is worth to look for tiles that have become closed.
    static constexpr int kWorthLooking = 4;
    typedef typename Fitting<kPixels>::Lanes Lanes;
    static constexpr int kLanes = sizeof(Lanes) / sizeof(float);

    void splat_run(const RowRun& run, const unsigned char* packets) {
        cells_.enter_row(run.sheet, run.row);
        const int most_together = cells_.tells_ordinals() ? most_together_ : 1;
        for (std::uint32_t n = 0; n < run.count; ++n, packets += kPacketBytes) {
            const ShadedSample sample = sample_at(packets, run, job_);
            const std::int64_t ordinal = cells_.ordinal_at(sample.x, sample.y);
            if (count_ == most_together || ordinal != first_ + way_ * count_) {
                paint_together();
                first_ = ordinal;
            }
            opacities_[count_] = sample.opacity;
            reds_[count_] = sample.red, greens_[count_] = sample.green, blues_[count_] = sample.blue;
            ++count_;
        }
        paint_together();
    }

    void paint_together() {
        if (count_ == 0) return;
        const std::int64_t last = first_ + way_ * (count_ - 1);
        const std::int64_t least = way_ > 0 ? first_ : last, greatest = way_ > 0 ? last : first_;
        const RowSpan rows = cells_.enter_cells(least, greatest);
        for (std::int64_t top = rows.begin; top < rows.end; top += kSpanRows) {
            RowSpans thirds[kThirds];
            cells_.spans(top, thirds);
            for (int n = 0; n < kSpanRows && top + n < rows.end; ++n) {
                RowSpan in[kThirds];
                for (int third = 0; third < kThirds; ++third)
                    in[third] = {thirds[third].begin[n], thirds[third].end[n]};
                if (count_ == 1) paint_one(top + n, in);
                else paint(top + n, in, least, greatest);
            }
        }
        count_ = 0;
    }

    // From the first to the last pixel of all thirds.
    static RowSpan around(const RowSpan (&thirds)[kThirds]) {
        RowSpan all{1 << 30, 0};
        for (const RowSpan& third : thirds) {
            if (third.begin >= third.end) continue;
            if (third.begin < all.begin) all.begin = third.begin;
            if (third.end > all.end) all.end = third.end;
        }
        return all;
    }

    // What of the opacities goes to the pixels from x on that lie in the span.
    template <class Some>
    static Some within(Some opacity, const RowSpan& span, int x) {
        typedef decltype(Some{} < Some{}) Bits;
        Bits nth;
        __builtin_memcpy(&nth, kCounts, sizeof nth);
        return (Some)((Bits)opacity & (nth >= span.begin - x) & (nth < span.end - x));
    }

    // What is written beyond the thirds of a row stays as it was.
    void paint_one(std::int64_t y, const RowSpan (&thirds)[kThirds]) {
        const Point<Lanes> point = in_all_lanes<Lanes>(opacities_[0], reds_[0], greens_[0], blues_[0]);
        const RowSpan all = around(thirds);
        float* place = pixel(all.begin, y);
        if (kFrontToBack && all.end > all.begin) unseen_pixels_ += all.end - all.begin + kLanes;
        for (int x = all.begin; x < all.end; x += kLanes, place += kLanes)
            combine_thirds(place, x, thirds, point, point);
    }

    void paint(std::int64_t y, const RowSpan (&thirds)[kThirds], std::int64_t least, std::int64_t greatest) {
        const RowSpan all = around(thirds);
        float* place = pixel(all.begin, y);
        if (kFrontToBack && all.end > all.begin) unseen_pixels_ += all.end - all.begin + kPixels;
        for (int x = all.begin; x < all.end; x += kPixels) {
            const RowInts far = places(0, x, y, least, greatest);
            const RowInts near = cells_.keeps_samples() ? far : places(1, x, y, least, greatest);
            if constexpr (kLanes == kPixels) {
                combine_thirds(place, x, thirds, points_at(far), points_at(near));
                place += kLanes;
            } else {
                std::int32_t numbers[2][kPixels];
                __builtin_memcpy(numbers[0], &far, sizeof far);
                __builtin_memcpy(numbers[1], &near, sizeof near);
                for (int n = 0; n < kPixels; n += kLanes, place += kLanes)
                    combine_thirds(place, x + n, thirds, points_at(numbers[0] + n), points_at(numbers[1] + n));
            }
        }
    }

    // Where among these the samples are in whose cells eight pixels lie on a face.
    RowInts places(int face, int x, std::int64_t y, std::int64_t least, std::int64_t greatest) const {
        return way_ * (cells_.ordinals(face, x, y, least, greatest) - static_cast<std::int32_t>(first_));
    }

    // From the first to the last third of the rays' way, or front to back.
    __attribute__((always_inline)) void combine_thirds(float* place, int x, const RowSpan (&thirds)[kThirds],
                                                       const Point<Lanes>& far, const Point<Lanes>& near) const {
        const std::int64_t plane = job_.image.plane;
        const float frozen = job_.frozen_alpha;
        Pixels<Lanes> pixels = load_pixels<Lanes>(place, plane);
        if constexpr (kFrontToBack) {
            combine<true>(pixels, within(near.opacity, thirds[2], x), near, frozen);
            combine<true>(pixels, within(far.opacity, thirds[1], x), far, frozen);
            combine<true>(pixels, within(far.opacity, thirds[0], x), far, frozen);
        } else {
            combine<false>(pixels, within(far.opacity, thirds[0], x), far, frozen);
            combine<false>(pixels, within(far.opacity, thirds[1], x), far, frozen);
            combine<false>(pixels, within(near.opacity, thirds[2], x), near, frozen);
        }
        store_pixels(pixels, place, plane);
    }

    __attribute__((noinline)) void look_for_closed_tiles() {
        unseen_pixels_ = 0;
        ClosedTiles(job_.image, job_.frozen_alpha).look(job_.row_begin, job_.row_end);
    }

    float* pixel(std::int64_t x, std::int64_t y) const { return job_.image.pixels + y * job_.image.pitch + x; }

    // The samples at these places, which rise or fall.
    Point<Lanes> points_at(const std::int32_t* places) const {
        float channels[4][kLanes];
        for (int n = 0; n < kLanes; ++n) {
            channels[0][n] = opacities_[places[n]], channels[1][n] = reds_[places[n]];
            channels[2][n] = greens_[places[n]], channels[3][n] = blues_[places[n]];
        }
        return {load<Lanes>(channels[0]), load<Lanes>(channels[1]), load<Lanes>(channels[2]), load<Lanes>(channels[3])};
    }

#ifdef __AVX2__
    Point<Eight> points_at(const RowInts& places) const {
        const std::int32_t first = places[0] < places[kPixels - 1] ? places[0] : places[kPixels - 1];
        const RowInts from_there = places - first;
        if (from_there[0] >= kPixels || from_there[kPixels - 1] >= kPixels) {
            std::int32_t numbers[kPixels];
            __builtin_memcpy(numbers, &places, sizeof numbers);
            return points_at(numbers);
        }
        const auto channel = [&](const float* samples) { return picked(load<Eight>(samples + first), from_there); };
        return {channel(opacities_), channel(reds_), channel(greens_), channel(blues_)};
    }
#endif

    static constexpr std::int32_t kCounts[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    static_assert(sizeof(Lanes) <= sizeof kCounts);

    const SplatJob& job_;
    SheetCells cells_;
    const int way_;  // from one sample's ordinal to the next one's
    const int most_together_;
    const std::int64_t worth_looking_;
    std::int64_t unseen_pixels_;
    std::int64_t first_ = 0;
    int count_ = 0;
    float opacities_[kMostTogether + kPixels], reds_[kMostTogether + kPixels];  // with room to load whole vectors
    float greens_[kMostTogether + kPixels], blues_[kMostTogether + kPixels];
};

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
