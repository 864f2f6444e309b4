// A region's own walker need not know what is closed elsewhere.
#include "walker_parts.h"

#include <stdexcept>

namespace volsplat {

WalkerParts::WalkerParts(const WalkPlan& plan, const std::vector<Lines>& lines, const Regions& regions,
                         std::int64_t walkers, const std::uint64_t* closed_tiles)
    : taking_turns_(walkers == 0 ? 1 : walkers), batch_parts_(walkers == 0 ? 1 : regions.count()) {
    if (walkers < 0) throw std::invalid_argument("somebody must walk");
    const auto closed_within = [&](const Lines& own) -> ClosedTiles* {
        if (!closed_tiles || own.begin == own.end) return nullptr;
        closed_tiles_.push_back(std::make_unique<ClosedTiles>(closed_tiles, plan, own, taking_turns_));
        return closed_tiles_.back().get();
    };
    if (walkers == 0) {
        for (std::size_t n = 0; n < lines.size(); ++n)
            parts_.push_back({0, regions.places(n), closed_within(lines[n])});
    } else {
        ClosedTiles* const closed = closed_within({0, plan.height});
        for (std::int64_t turn = 0; turn < walkers; ++turn) parts_.push_back({turn, regions.all(), closed});
    }
}

}  // namespace volsplat
