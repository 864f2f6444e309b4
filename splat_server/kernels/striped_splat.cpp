#include "striped_splat.h"

#include <algorithm>
#include <vector>

#include "splat.h"

namespace volsplat {
namespace {

// More stripes than threads, since a volume rarely lies evenly in the image.
constexpr int kStripesPerThread = 4;

// Rows of the image that some samples may reach, whatever the run.
RowSpan reached_rows(const std::vector<RowSpan>& run_rows, const SplatJob& job) {
    RowSpan all{job.image.height, 0};
    for (const RowSpan& rows : run_rows) all = {std::min(all.begin, rows.begin), std::max(all.end, rows.end)};
    return {std::max(all.begin, 0), std::min(all.end, job.image.height)};
}

}  // namespace

void splat_into(ImageMemory& image, SplatJob job, StripePool* pool) {
    job.image = image.view();
    job.row_begin = 0, job.row_end = image.height();
    if (!pool || pool->threads() == 1) {
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
    const int stripes = std::min(pool->threads() * kStripesPerThread, tiles);
    std::vector<SplatOutcome> outcomes(stripes);
    pool->share_out(stripes, [&](int n) {
        SplatJob stripe = job;
        stripe.row_begin = (first_tile + tiles * n / stripes) * kTileSide;
        stripe.row_end = std::min((first_tile + tiles * (n + 1) / stripes) * kTileSide, image.height());
        outcomes[n] = splat(stripe);
    });
    for (const SplatOutcome& outcome : outcomes) image.note(outcome);
}

}  // namespace volsplat
