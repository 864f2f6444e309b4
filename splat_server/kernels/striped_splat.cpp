#include "striped_splat.h"

#include <algorithm>
#include <vector>

#include "splat.h"

namespace volsplat {
namespace {

// More stripes than threads, since a volume rarely lies evenly in the image; not many more, since what lies across
// their ends is decoded twice.
constexpr int kStripesPerThread = 2;
// All but low footprints are splatted in stripes of so many rows, or of so many footprints: then the pixels around a run
// stay in the first caches while its neighbours follow. A low footprint's do so anyway.
constexpr int kLowFootprint = 12, kStripeRows = 128, kStripeFootprints = 3;

// Rows of the image that some samples may reach, whatever the run.
RowSpan reached_rows(const std::vector<RowSpan>& run_rows, const SplatJob& job) {
    RowSpan all{job.image.height, 0};
    for (const RowSpan& rows : run_rows) all = {std::min(all.begin, rows.begin), std::max(all.end, rows.end)};
    return {std::max(all.begin, 0), std::min(all.end, job.image.height)};
}

}  // namespace

void splat_into(ImageMemory& image, SplatJob job, StripePool* pool) {
    job.image = image.view();
    job.row_begin = 0, job.row_end = job.image.height;
    const int threads = pool ? pool->threads() : 1;
    if (threads == 1 && job.footprint.height < kLowFootprint) {
        image.note(splat(job));
        return;
    }
    std::size_t runs = 0;
    for (std::size_t s = 0; s < job.span_count; ++s) runs += job.spans[s].run_count;
    std::vector<RowSpan> run_rows(runs);
    find_run_rows(job, run_rows.data());
    job.run_rows = run_rows.data();

    const RowSpan rows = reached_rows(run_rows, job);
    if (rows.begin >= rows.end) return;
    const int first_tile = rows.begin / kTileSide, tiles = (rows.end - 1) / kTileSide - first_tile + 1;
    const int height = job.footprint.height < kLowFootprint
                           ? job.image.height
                           : std::max(kStripeRows, kStripeFootprints * job.footprint.height);
    const int low_stripes = (rows.end - rows.begin - 1) / height + 1;
    const int stripes = std::min(std::max(threads > 1 ? threads * kStripesPerThread : 1, low_stripes), tiles);
    std::vector<SplatOutcome> outcomes(stripes);
    const auto splat_stripe = [&](int n) {
        SplatJob stripe = job;
        stripe.row_begin = (first_tile + tiles * n / stripes) * kTileSide;
        stripe.row_end = std::min((first_tile + tiles * (n + 1) / stripes) * kTileSide, job.image.height);
        outcomes[n] = splat(stripe);
    };
    if (pool) pool->share_out(stripes, splat_stripe);
    else for (int n = 0; n < stripes; ++n) splat_stripe(n);
    for (const SplatOutcome& outcome : outcomes) image.note(outcome);
}

}  // namespace volsplat
