// Fills a footprint table, the offsets of one row of them; the same bits on every path, so that a table may be kept
// when the path changes.
#include "splat_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

void fill_footprints(const FootprintBox& box, int fy, float* weights) {
    const float offset_step = 1.0f / static_cast<float>(box.offsets);
    const float last = static_cast<float>(box.intervals);
    const float top = static_cast<float>(box.start_y[fy]) - static_cast<float>(fy) * offset_step;
    for (int fx = 0; fx < box.offsets; ++fx) {
        const float left = static_cast<float>(box.start_x[fx]) - static_cast<float>(fx) * offset_step;
        for (int y = 0; y < box.height; ++y, weights += box.pitch) {
            const float dy = top + static_cast<float>(y);
            const float along_y = box.qyy * dy * dy, twice_xy = 2.0f * box.qxy * dy;
            for (int x = 0; x < box.width; ++x) {
                const float dx = left + static_cast<float>(x);
                const float square = box.radius_square - (along_y + (twice_xy + box.qxx * dx) * dx);
                const float place = __builtin_sqrtf(square > 0.0f ? square : 0.0f) * box.intervals_per_chord;
                const float within = place < last ? place : last;
                const std::int32_t cell = static_cast<std::int32_t>(within);
                const float low = box.over_half_chord[cell], high = box.over_half_chord[cell + 1];
                weights[x] = low + (within - static_cast<float>(cell)) * (high - low);
            }
        }
    }
}

}  // namespace volsplat::VOLSPLAT_PATH
