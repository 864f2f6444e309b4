// A table from rows of tiles to regions, and each region's lines with the reach around them.
#include "regions.h"

#include <algorithm>

#include "kernels/tile_map.h"

namespace volsplat {

Regions::Regions(const std::vector<Lines>& lines, const WalkPlan& plan)
    : reach_(sample_reach(plan).y), height_(plan.height), of_tiles_(static_cast<std::size_t>(tile_rows(plan.height))) {
    for (const Lines& region : lines) {
        const auto number = static_cast<std::uint32_t>(places_.size());
        if (region.begin == region.end) {
            places_.push_back({0, -1});
            continue;
        }
        places_.push_back({region.begin * kPixel - reach_, (region.end - 1) * kPixel + reach_});
        const std::int64_t end = (region.end - 1) / kTileSide + 1;
        std::fill(of_tiles_.begin() + region.begin / kTileSide, of_tiles_.begin() + end, number);
    }
}

Regions::Places Regions::all() const { return {-reach_, (height_ - 1) * kPixel + reach_}; }

Regions::Range Regions::reached(std::int64_t y, std::int64_t other_y) const {
    const auto region = [this](std::int64_t line) {
        return of_tiles_[std::clamp<std::int64_t>(line, 0, height_ - 1) / kTileSide];
    };
    return {region((std::min(y, other_y) - reach_ + kPixel - 1) >> kFractionBits),
            region((std::max(y, other_y) + reach_) >> kFractionBits)};
}

}  // namespace volsplat
