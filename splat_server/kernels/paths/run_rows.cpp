// Which rows of pixels each run reaches, so that a stripe need not decode the runs that do not.
#include "shaded_sample.h"
#include "sheet_cells.h"
#include "splat_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr std::int64_t kFarthest = std::int64_t(1) << 32;  // pixels: any position reaches all of the image

// Least and greatest y of a run's packets, in 1/64 pixel from its origin: those of its ends.
struct Extent {
    std::int64_t least, greatest;
};

Extent extent_of(const unsigned char* packets, std::uint64_t count) {
    const std::int64_t first = y_of(packet_at(packets)), last = y_of(packet_at(packets + (count - 1) * kPacketBytes));
    return first < last ? Extent{first, last} : Extent{last, first};
}

// How many rows a sample reaches up and down from its position.
std::int64_t reach_of(const SplatJob& job) {
    if (job.reach == Reach::pixel) return 1;
    if (job.reach == Reach::footprint) return job.footprint.height / 2 + 2;
    // A cell ends no further from its middle than the next samples are, and where a ray enters or leaves the sheet it
    // is no further from the sample
    double rows = 2;
    for (int axis = 1; axis < 3; ++axis) rows += 2 * pixels_apart(job.cell, 1, axis);
    return rows < kFarthest ? static_cast<std::int64_t>(rows) : kFarthest;
}

std::int32_t limited(std::int64_t row, int height) {
    return static_cast<std::int32_t>(row < 0 ? 0 : row < height ? row : height);
}

}  // namespace

void find_run_rows(const SplatJob& job, RowSpan* rows) {
    const std::int64_t around = reach_of(job);
    for (std::size_t s = 0; s < job.span_count; ++s) {
        const unsigned char* packets = job.spans[s].packets;
        for (std::uint64_t r = 0; r < job.spans[s].run_count; ++r, ++rows) {
            const RowRun run = run_at(job.spans[s].runs, r);
            const Extent extent = extent_of(packets, run.count);
            *rows = {limited(((run.y0 + extent.least) >> kSubpixelBits) - around, job.image.height),
                     limited(((run.y0 + extent.greatest) >> kSubpixelBits) + around + 1, job.image.height)};
            packets += std::uint64_t(run.count) * kPacketBytes;
        }
    }
}

}  // namespace volsplat::VOLSPLAT_PATH
