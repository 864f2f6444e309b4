// Splats cells: for each sample the rows of the image that its cell touches, and in each of these the pixels inside.
#pragma once
#include "pixel_vectors.h"
#include "shaded_sample.h"
#include "sheet_cells.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

template <bool kFrontToBack>
class CellLoop {
public:
    explicit CellLoop(const SplatJob& job) : job_(job), cells_(job) {}

    void run() {
        if (cells_.empty()) return;
        for (size_t s = 0; s < job_.span_count; ++s) {
            const unsigned char* packets = job_.spans[s].packets;
            for (uint64_t r = 0; r < job_.spans[s].run_count; ++r) {
                const RowRun run = run_at(job_.image, job_.spans[s].runs, r);
                cells_.enter_row(run.sheet, run.row);
                for (uint32_t n = 0; n < run.count; ++n, packets += 8) splat(sample_at(packets, run, job_));
            }
        }
    }

private:
    void splat(const ShadedSample& sample) {
        int64_t v_low, v_high, top, bottom;
        cells_.cell_at(sample.x, sample.y, v_low, v_high);
        cells_.image_rows(v_low, v_high, top, bottom);
        const Point<Widest> point = in_all_lanes<Widest>(sample.opacity, sample.red, sample.green, sample.blue);
        for (; top < bottom; top += kSpanRows) {
            const RowSpans spans = cells_.spans(top, v_low, v_high);
            const int rows = bottom - top < kSpanRows ? static_cast<int>(bottom - top) : kSpanRows;
            for (int n = 0; n < rows; ++n) paint(top + n, spans.begin[n], spans.end[n], point);
        }
    }

    // Weight 1 on the pixels x..x_end of a row; what is written beyond them stays as it was.
    void paint(int64_t y, int x, int x_end, const Point<Widest>& point) {
        const ImageView& image = job_.image;
        float* pixels = image.pixels + y * image.pitch + x;
        for (; x < x_end; x += kWidest, pixels += kWidest) {
            const float* weights = kOnesAndZeros + (x_end - x < kWidest ? kWidest - (x_end - x) : 0);
            combine<kFrontToBack, false, Widest>(pixels, image.plane, weights + kOnes - kWidest, point);
        }
    }

    static constexpr int kOnes = 16;
    static constexpr float kOnesAndZeros[2 * kOnes] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
    static_assert(kWidest <= kOnes);

    const SplatJob& job_;
    SheetCells cells_;
};

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
