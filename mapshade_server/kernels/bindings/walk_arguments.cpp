#include "walk_arguments.h"

#include <stdexcept>

#include "kernels/tile_map.h"

namespace volsplat {

Dda dda_of(const DdaNumbers& numbers) { return {numbers[0], {numbers[1], numbers[2], numbers[3]}}; }

AxisVisits visits_of(const VisitNumbers& numbers) {
    return {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]};
}

Index3 size_of(const PacketArray& packets) {
    return {static_cast<std::int64_t>(packets.shape(2)), static_cast<std::int64_t>(packets.shape(1)),
            static_cast<std::int64_t>(packets.shape(0))};
}

void check_tiles(const TileArray& tiles, const WalkPlan& plan) {
    if (static_cast<std::int64_t>(tiles.shape(0)) != tile_rows(plan.height) ||
        static_cast<std::int64_t>(tiles.shape(1)) != tile_words(plan.width)) {
        throw std::invalid_argument("the map of closed tiles is not that of the image's size");
    }
}

std::vector<Lines> regions_of(const std::vector<LineNumbers>& regions, std::int64_t lines) {
    std::vector<Lines> found;
    std::int64_t last = 0;
    for (const auto& [begin, end] : regions) {
        if (begin != last || end < begin || (end % kTileSide != 0 && end != lines)) {
            throw std::invalid_argument("regions must follow each other, cut between tiles");
        }
        found.push_back({begin, end});
        last = end;
    }
    if (last != lines) throw std::invalid_argument("the regions are not those of the image's lines");
    return found;
}

BatchLimits limits_of(std::int64_t max_packets, std::int64_t max_voxels) {
    if (max_packets < 1 || max_voxels < 1)
        throw std::invalid_argument("a batch needs room for at least one packet and voxel");
    return {static_cast<std::size_t>(max_packets), max_voxels};
}

}  // namespace volsplat
