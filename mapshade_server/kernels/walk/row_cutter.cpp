// Each region gets the part of a row between two places, found by arithmetic and not by a test for each sample.
#include "row_cutter.h"

#include <algorithm>
#include <cstdlib>

#include "mapshade_server/kernels/batches/run_lattice.h"
#include "narrow.h"

namespace volsplat {

// Gives each region what reaches it; some samples reach two.
std::size_t RowCutter::deliver(const ShadedRow& row, Batch& batch) const {
    const std::size_t count = row.survivors.voxels.count;
    if (count == 0) return 0;
    if (batch.parts.size() == 1) return cut_into_runs(row, 0, count, batch.parts[0]);
    const std::uint16_t* positions = row.survivors.voxels.positions;
    const std::int64_t first = positions[0], last = positions[count - 1];
    const RowLine& line = row.line;
    const Regions::Range reached =
        regions_.reached(line.start_y + first * line.step_y, line.start_y + last * line.step_y);
    if (reached.first == reached.last) return cut_into_runs(row, 0, count, batch.parts[reached.first]);
    std::size_t delivered = 0;
    for (std::size_t region = reached.first; region <= reached.last; ++region) {
        const Regions::Places& places = regions_.places(region);
        std::int64_t begin = first, end = last + 1;
        narrow(line.start_y, line.step_y, places.least, places.greatest, begin, end);
        const std::uint16_t* from = std::lower_bound(positions, positions + count, begin);
        const std::uint16_t* to = std::lower_bound(from, positions + count, end);
        delivered += cut_into_runs(row, static_cast<std::size_t>(from - positions),
                                   static_cast<std::size_t>(to - positions), batch.parts[region]);
    }
    return delivered;
}

// Cuts survivors into runs that a run's offsets can span, in traversal order; returns how many they are.
std::size_t RowCutter::cut_into_runs(const ShadedRow& row, std::size_t begin, std::size_t end, ShadedPart& part) const {
    const std::uint16_t* positions = row.survivors.voxels.positions;
    const RowLine& line = row.line;
    const bool descending = !plan_.ascending[2];
    const std::int64_t step = std::max(std::abs(line.step_x), std::abs(line.step_y));
    const std::int64_t farthest = step <= kLongestRun / kLongestRow ? kLongestRow : kLongestRun / step;
    const std::size_t count = end - begin;
    while (begin < end) {
        // Find the survivors that are near enough to the run's first
        const std::int64_t head = positions[descending ? end - 1 : begin];
        std::size_t low = begin, high = end;
        if (std::abs(positions[descending ? begin : end - 1] - head) > farthest) {
            if (descending) {
                low = end - 1;
                while (head - positions[low - 1] <= farthest) --low;
            } else {
                high = begin + 1;
                while (positions[high] - head <= farthest) ++high;
            }
        }

        // Place the origin at the smaller position on each axis: one end of the run
        const std::int64_t tail = positions[descending ? low : high - 1];
        const auto origin_x = static_cast<std::int32_t>(
            std::min(lattice(line.start_x + head * line.step_x), lattice(line.start_x + tail * line.step_x)));
        const auto origin_y = static_cast<std::int32_t>(
            std::min(lattice(line.start_y + head * line.step_y), lattice(line.start_y + tail * line.step_y)));
        const std::int64_t head_ordinal = row.origin + head;
        const std::int64_t first = descending ? plan_.visits_of(2).count - 1 - head_ordinal : head_ordinal;
        const std::size_t run = high - low;
        part.runs.push_back({static_cast<std::uint32_t>(row.sheet), static_cast<std::uint32_t>(row.row),
                             static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(run), origin_x, origin_y});
        kernels_.shade(row.survivors, colours_, line, {low, run, origin_x, origin_y, descending}, part.append(run));
        (descending ? end : begin) = descending ? low : high;
    }
    return count;
}

}  // namespace volsplat
