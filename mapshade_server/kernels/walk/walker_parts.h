// Who walks what of a frame: some walkers take turns and serve all regions, or each region has a walker of its own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "closed_tiles.h"
#include "regions.h"
#include "walk_plan.h"

namespace volsplat {

struct WalkerPart {
    std::int64_t turn;          // among those that take turns
    Regions::Places places;     // that its samples must reach
    ClosedTiles* closed_tiles;  // null where nothing may be left out
};

class WalkerParts {
public:
    // So many walkers that take turns, or, with 0, one for each region, which `lines` are. `closed_tiles` is null where
    // nothing may be left out.
    WalkerParts(const WalkPlan& plan, const std::vector<Lines>& lines, const Regions& regions, std::int64_t walkers,
                const std::uint64_t* closed_tiles);

    std::int64_t count() const { return static_cast<std::int64_t>(parts_.size()); }
    const WalkerPart& of(std::int64_t walker) const { return parts_.at(static_cast<std::size_t>(walker)); }
    std::int64_t taking_turns() const { return taking_turns_; }
    // Of a batch: for the walker's own region, or for each.
    std::size_t batch_parts() const { return batch_parts_; }

private:
    const std::int64_t taking_turns_;
    const std::size_t batch_parts_;
    std::vector<std::unique_ptr<ClosedTiles>> closed_tiles_;
    std::vector<WalkerPart> parts_;
};

}  // namespace volsplat
