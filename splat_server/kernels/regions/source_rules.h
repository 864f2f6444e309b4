// What a source of a frame may hand out: it may be broken or hostile, so that nothing is taken unchecked.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "merge.h"

namespace volsplat {

struct FrameCounts {  // visited samples along sheet, row and sample; ordinals lie below them
    std::uint64_t sheets, rows, samples;
};

struct PartView {  // what of a batch is for one region; the addresses need no alignment
    SpanView runs;
    std::uint64_t packet_count;
};

class SourceRules {
public:
    SourceRules(const FrameCounts& counts, std::size_t regions) : counts_(counts), bounds_(regions, {0, 0, 0}) {}

    // Throws std::invalid_argument naming the fault, and notes nothing, if the batch breaks the rules.
    void check(std::span<const PartView> parts, std::uint64_t reached_sheet, std::uint64_t reached_row, bool last);
    // No later run of the region lies before it.
    const MergeKey& bound(std::size_t region) const { return bounds_[region]; }
    // Nothing comes any more. False if that was known.
    bool finish();
    bool finished() const { return finished_; }  // any thread may ask

private:
    MergeKey bound_after(const PartView& part, MergeKey bound) const;

    const FrameCounts counts_;
    std::vector<MergeKey> bounds_;
    std::atomic<bool> finished_{false};
};

}  // namespace volsplat
