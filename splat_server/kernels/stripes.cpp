#include "stripes.h"

#include <algorithm>
#include <cstdint>

#include "paths/splat_kernels.h"

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

std::size_t number_of_runs(const SplatJob& job) {
    std::size_t runs = 0;
    for (std::size_t s = 0; s < job.span_count; ++s) runs += job.spans[s].run_count;
    return runs;
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

StripedJob::StripedJob(const SplatJob& job, const std::vector<RowSpan>& stripes) : job_(job) {
    for (const RowSpan& lines : stripes) parts_.push_back({lines, {}, nullptr});
    if (stripes.size() == 1) {
        parts_[0].spans.assign(job.spans, job.spans + job.span_count);
        return;
    }
    const auto begins_before_end = [](std::int32_t line, const Part& part) { return line < part.lines.end; };
    std::vector<RowSpan> rows(number_of_runs(job));
    splat_kernels().find_run_rows(job, rows.data());
    auto reached = rows.begin();
    for (std::size_t s = 0; s < job.span_count; ++s) {
        SpanView run = job.spans[s];
        run.run_count = 1;
        for (std::uint64_t r = 0; r < job.spans[s].run_count; ++r, ++reached) {
            const unsigned char* const packets_end =
                run.packets + std::size_t(run_at(run.runs, 0).count) * kPacketBytes;
            auto part = std::upper_bound(parts_.begin(), parts_.end(), reached->begin, begins_before_end);
            for (; part != parts_.end() && part->lines.begin < reached->end; ++part) {
                run.whole = reached->begin >= part->lines.begin && reached->end <= part->lines.end;
                part->add(run, packets_end);
            }
            run.packets = packets_end;
            run.runs += sizeof(RowRun);
        }
    }
}

// Runs that follow each other, as their packets do, make one span.
void StripedJob::Part::add(const SpanView& run, const unsigned char* run_packets_end) {
    const SpanView* const last = spans.empty() ? nullptr : &spans.back();
    if (last && last->whole == run.whole && last->runs + last->run_count * sizeof(RowRun) == run.runs &&
        packets_end == run.packets)
        ++spans.back().run_count;
    else spans.push_back(run);
    packets_end = run_packets_end;
}

SplatOutcome StripedJob::splat(std::size_t stripe) const {
    const Part& part = parts_[stripe];
    if (part.spans.empty()) return {part.lines.end, part.lines.begin, 0};
    SplatJob job = job_;
    job.spans = part.spans.data(), job.span_count = part.spans.size();
    job.row_begin = part.lines.begin, job.row_end = part.lines.end;
    return splat_kernels().splat(job);
}

}  // namespace volsplat
