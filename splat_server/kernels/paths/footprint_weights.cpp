// Fills a footprint table, a band of a row of offsets; the same bits on every path, so that a table may be kept when
// the path changes.
#include "kernels/wide_lanes.h"
#include "splat_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

Reals weights_of(const FootprintBox& box, Reals square) {
    const Reals place = square_root(at_least_0(square)) * box.intervals_per_chord;
    const Reals last = all_lanes<Reals>(static_cast<float>(box.intervals));
    const Reals within = place < last ? place : last;
    const Integers cell = __builtin_convertvector(within, Integers);
    const Reals low = looked_up(box.over_half_chord, (Words)cell);
    const Reals high = looked_up(box.over_half_chord + 1, (Words)cell);
    return low + (within - __builtin_convertvector(cell, Reals)) * (high - low);
}

}  // namespace

void fill_footprints(const FootprintBox& box, const FootprintBand& band, float* weights) {
    const float offset_step = 1.0f / static_cast<float>(box.offsets);
    for (int fx = 0; fx < box.offsets; ++fx, weights += box.weights) {
        const float left = static_cast<float>(box.start_x[fx]) - static_cast<float>(fx) * offset_step;
        for (std::size_t n = 0; n < band.count; n += kWidest) {
            const Reals dx = load<Reals>(box.x + n) + left;
            const Reals along = load<Reals>(band.along_y + n) + (load<Reals>(band.twice_xy + n) + dx * box.qxx) * dx;
            store_first(weights + n, weights_of(box, box.radius_square - along), band.count - n);
        }
    }
}

}  // namespace volsplat::VOLSPLAT_PATH
