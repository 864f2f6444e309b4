#include "stripes.h"

#include <algorithm>

#include "splat.h"

namespace volsplat {
namespace {

// More stripes than threads, since a volume rarely lies evenly in the image; not many more, since what lies across
// their ends is decoded twice.
constexpr int kStripesPerThread = 2;
// All but low footprints are splatted in stripes of so many lines, or of so many footprints: then the pixels around a
// run stay in the first caches while its neighbours follow. A low footprint's do so anyway.
constexpr int kLowFootprint = 12, kStripeLines = 128, kStripeFootprints = 3;

int number_of_stripes(int lines, int footprint_height, int threads) {
    const int for_threads = threads > 1 ? threads * kStripesPerThread : 1;
    if (footprint_height < kLowFootprint) return for_threads;
    const int highest = std::max(kStripeLines, kStripeFootprints * footprint_height);
    return std::max(for_threads, (lines - 1) / highest + 1);
}

}  // namespace

std::vector<RowSpan> stripes_of(int lines, RowSpan busy, int footprint_height, int threads) {
    busy = {std::clamp(busy.begin, 0, lines - 1), std::clamp(busy.end, 1, lines)};
    if (busy.begin >= busy.end) busy = {0, lines};
    const int first_tile = busy.begin / kTileSide, tiles = (busy.end - 1) / kTileSide - first_tile + 1;
    const int count = std::min(number_of_stripes(busy.end - busy.begin, footprint_height, threads), tiles);
    std::vector<RowSpan> stripes(count);
    for (int n = 0; n < count; ++n)
        stripes[n] = {(first_tile + tiles * n / count) * kTileSide, (first_tile + tiles * (n + 1) / count) * kTileSide};
    stripes.front().begin = 0;
    stripes.back().end = lines;
    return stripes;
}

StripedJob::StripedJob(const SplatJob& job, int stripes) : job_(job), reached_{0, job.image.height} {
    if (stripes == 1) return;
    std::size_t runs = 0;
    for (std::size_t s = 0; s < job.span_count; ++s) runs += job.spans[s].run_count;
    run_rows_.resize(runs);
    find_run_rows(job, run_rows_.data());
    reached_ = {job.image.height, 0};
    for (const RowSpan& rows : run_rows_)
        reached_ = {std::min(reached_.begin, rows.begin), std::max(reached_.end, rows.end)};
}

SplatOutcome StripedJob::splat(RowSpan stripe) const {
    if (!reaches(stripe)) return {stripe.end, stripe.begin, 0};
    SplatJob job = job_;
    job.run_rows = run_rows_.empty() ? nullptr : run_rows_.data();
    job.row_begin = stripe.begin, job.row_end = stripe.end;
    return volsplat::splat(job);
}

bool StripedJob::reaches(RowSpan stripe) const { return reached_.begin < stripe.end && reached_.end > stripe.begin; }

}  // namespace volsplat
