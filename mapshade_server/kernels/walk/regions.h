// The regions of the image, and which of them samples reach: protocol/rules/regions.py.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "sample_reach.h"
#include "walk_plan.h"

namespace volsplat {

// Lines of an image, half open.
struct Lines {
    std::int64_t begin, end;
};

class Regions {
public:
    // They follow each other, cut between tiles, and hold all lines.
    Regions(const std::vector<Lines>& lines, const WalkPlan& plan);

    std::size_t count() const { return places_.size(); }

    // Regions that samples between two places on the y axis may reach, and empty ones between them; none if first >
    // last.
    struct Range {
        std::size_t first, last;
    };
    Range reached(std::int64_t y, std::int64_t other_y) const;

    // From where to where samples may reach a region, ends included; nowhere, where it is empty.
    struct Places {
        std::int64_t least, greatest;
    };
    const Places& places(std::size_t region) const { return places_[region]; }
    // From where to where samples may reach the image.
    Places all() const;

private:
    std::int64_t reach_, height_;
    std::vector<Places> places_;
    std::vector<std::uint32_t> of_tiles_;  // the region of each row of tiles
};

}  // namespace volsplat
