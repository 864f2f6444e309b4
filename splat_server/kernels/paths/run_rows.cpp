// Which rows of pixels each run reaches, so that a stripe need not decode the runs that do not.
#include "shaded_sample.h"
#include "splat_loops.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

// Least and greatest y of some packets, in 1/64 pixel from their run's origin.
struct Extent {
    int least, greatest;
};

Extent extent_of(const unsigned char* packets, uint64_t count) {
    Integers least = Integers{} + kPositionMask, greatest{};
    uint64_t n = 0;
    for (; n + kAtOnce <= count; n += kAtOnce) {
        const Integers y = packets_at(packets + n * 8, kAtOnce).y();
        least = y < least ? y : least;
        greatest = y > greatest ? y : greatest;
    }
    const Integers rest = packets_at(packets + n * 8, count - n).y();
    Extent extent{kPositionMask, 0};
    for (int lane = 0; lane < kAtOnce; ++lane) {
        if (least[lane] < extent.least) extent.least = least[lane];
        if (greatest[lane] > extent.greatest) extent.greatest = greatest[lane];
        if (n + lane < count && rest[lane] < extent.least) extent.least = rest[lane];
        if (n + lane < count && rest[lane] > extent.greatest) extent.greatest = rest[lane];
    }
    return extent;
}

int32_t limited(int64_t row, int height) {
    return static_cast<int32_t>(row < 0 ? 0 : row < height ? row : height);
}

}  // namespace

void find_run_rows(const SplatJob& job, RowSpan* rows) {
    const bool everywhere = job.reach == Reach::cell;
    const int64_t around = job.reach == Reach::footprint ? job.footprint.height / 2 + 2 : 1;
    for (size_t s = 0; s < job.span_count; ++s) {
        const unsigned char* packets = job.spans[s].packets;
        for (uint64_t r = 0; r < job.spans[s].run_count; ++r, ++rows) {
            const RowRun run = run_at(job.spans[s].runs, r);
            const Extent extent = extent_of(packets, run.count);
            *rows = {limited(((run.y0 + int64_t(extent.least)) >> kSubpixelBits) - around, job.image.height),
                     limited(((run.y0 + int64_t(extent.greatest)) >> kSubpixelBits) + around + 1, job.image.height)};
            if (everywhere) *rows = {0, job.image.height};
            packets += uint64_t(run.count) * 8;
        }
    }
}

}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
