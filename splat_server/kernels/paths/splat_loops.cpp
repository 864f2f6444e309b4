// The splat loops (paper: "Combining"), compiled once per instruction set.
#include "splat_kernels.h"

#include "cell_loop.h"
#include "footprint_loop.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

// One pixel, weight 1.
template <bool kFrontToBack>
inline void combine_whole(const SplatJob& job, std::int64_t x, std::int64_t y, const ShadedSample& sample) {
    const ImageView& image = job.image;
    float* const pixel = image.pixels + y * image.pitch + x;
    float& alpha = pixel[3 * image.plane];
    const float intensity[] = {sample.red, sample.green, sample.blue};
    if constexpr (kFrontToBack) {
        if (!(alpha < job.frozen_alpha)) return;
        const float visible = (1.0f - alpha) * sample.opacity;
        for (int c = 0; c < 3; ++c) pixel[c * image.plane] += visible * intensity[c];
        alpha += visible;
    } else {
        const float through = 1.0f - sample.opacity;
        for (int c = 0; c < 3; ++c)
            pixel[c * image.plane] = through * pixel[c * image.plane] + sample.opacity * intensity[c];
        alpha = through * alpha + sample.opacity;
    }
}

template <bool kFrontToBack>
void splat_nearest_pixels(const SplatJob& job) {
    for (std::size_t s = 0; s < job.span_count; ++s) {
        const unsigned char* packets = job.spans[s].packets;
        for (std::uint64_t r = 0; r < job.spans[s].run_count; ++r) {
            const RowRun run = run_at(job.spans[s].runs, r);
            count_work(job, run, packets);
            const unsigned char* const end = packets + std::uint64_t(run.count) * kPacketBytes;
            for (; packets != end; packets += kPacketBytes) {
                const ShadedSample sample = sample_at(packets, run, job);
                const std::int64_t half = 1 << (kSubpixelBits - 1);
                const std::int64_t x = (sample.x + half) >> kSubpixelBits, y = (sample.y + half) >> kSubpixelBits;
                if (x < 0 || x >= job.image.width || y < job.row_begin || y >= job.row_end) continue;
                combine_whole<kFrontToBack>(job, x, y, sample);
            }
        }
    }
}

template <bool kFrontToBack>
SplatOutcome splat_in_order(const SplatJob& job) {
    if (job.reach == Reach::footprint)
        return job.footprint.clamped ? splat_footprints<kFrontToBack, true>(job)
                                     : splat_footprints<kFrontToBack, false>(job);
    if (job.reach == Reach::cell) return CellLoop<kFrontToBack>(job).run();
    splat_nearest_pixels<kFrontToBack>(job);
    return {job.row_begin, job.row_end, 0, 0};
}

}  // namespace

SplatOutcome splat(const SplatJob& job) {
    return job.front_to_back ? splat_in_order<true>(job) : splat_in_order<false>(job);
}

}  // namespace volsplat::VOLSPLAT_PATH
