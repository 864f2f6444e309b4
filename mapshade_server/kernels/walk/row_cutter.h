// Cuts shaded rows into what each region gets of them, and that into row runs (protocol/rules/packet_layout.py).
#pragma once

#include <cstddef>
#include <cstdint>

#include "mapshade_server/kernels/batches/batch.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "regions.h"
#include "walk_plan.h"

namespace volsplat {

// What is seen of a row, or of a part of it whose blocks are all of one size.
struct ShadedRow {
    std::int64_t sheet, row;  // in traversal order
    std::int64_t origin;      // the ordinal of the sample at position 0
    RowLine line;
    SurvivingSamples survivors;
};

// All that it is given outlives it.
class RowCutter {
public:
    RowCutter(const WalkPlan& plan, const Regions& regions, const ColourTables& colours)
        : kernels_(map_shade_kernels()), plan_(plan), regions_(regions), colours_(colours) {}

    // Appends it to the parts of the regions that it reaches, or to the one part; returns how many packets it has
    // become.
    std::size_t deliver(const ShadedRow& row, Batch& batch) const;

private:
    std::size_t cut_into_runs(const ShadedRow& row, std::size_t begin, std::size_t end, ShadedPart& part) const;

    const MapShadeKernels& kernels_;
    const WalkPlan& plan_;
    const Regions& regions_;
    const ColourTables& colours_;
};

}  // namespace volsplat
