// Leaves out samples that lie where the image is closed, one bit looked up for each.
#include "kernels/wide_lanes.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr float kPixel = 4294967296.0f;  // 2^-32 pixel

// Pixels along one axis in which samples of a line lie, moved into the image. All instruction sets round alike; see
// ClosedTiles for how much.
struct LinePixels {
    float start, step;
    std::int32_t last;

    LinePixels(std::int64_t line_start, std::int64_t line_step, std::int32_t last_pixel)
        : start(static_cast<float>(line_start) / kPixel),
          step(static_cast<float>(line_step) / kPixel),
          last(last_pixel) {}

    Integers at(Integers n) const {
        const Integers pixels = __builtin_convertvector(start + __builtin_convertvector(n, Reals) * step, Integers);
        const Integers not_beyond = pixels < last ? pixels : Integers{} + last;
        return not_beyond > 0 ? not_beyond : Integers{};
    }
};

// A bit for each lane: not hidden.
std::uint32_t open_lanes(const HiddenMap& map, const LinePixels& x, const LinePixels& y, Integers n) {
    const Integers column = x.at(n), word = y.at(n) * map.words_in_row + (column >> 5);
    return signs(~looked_up(map.words, (Words)word) << (31 & ~(Words)column));
}

}  // namespace

std::size_t leave_out_hidden(const VisibleVoxels& voxels, const HiddenMap& map, const RowLine& line,
                             std::uint16_t* positions, std::uint32_t* packets) {
    if (voxels.count == 0) return 0;
    // Counted from the first voxel, which lies near the image, float32 is enough
    const std::int32_t first = voxels.positions[0];
    const LinePixels x(line.start_x + first * line.step_x, line.step_x, map.last_column);
    const LinePixels y(line.start_y + first * line.step_y, line.step_y, map.last_row);
    std::size_t kept = 0;
    for (std::size_t at = 0; at < voxels.count; at += kWidest) {
        const Integers lanes = widened(voxels.positions + at);
        const std::uint32_t open = open_lanes(map, x, y, lanes - first) & lanes_before(voxels.count - at);
        if (open == 0) continue;  // and do not wait for its packets
        store_chosen(positions + kept, open, (Words)lanes);
        store_chosen(packets + kept, open, voxels.packets + at);
        kept += static_cast<unsigned>(__builtin_popcount(open));
    }
    return kept;
}

}  // namespace volsplat::VOLSPLAT_PATH
