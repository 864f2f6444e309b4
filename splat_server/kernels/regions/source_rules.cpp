#include "source_rules.h"

#include <stdexcept>
#include <string>
#include <utility>

namespace volsplat {

namespace {

std::string place(const MergeKey& key) {
    return "(sheet " + std::to_string(key.sheet) + ", row " + std::to_string(key.row) + ", sample " +
           std::to_string(key.first) + ")";
}

std::string run_name(std::uint64_t number, const RowRun& run) {
    return "run " + std::to_string(number) + " at " + place(key_of(run));
}

}  // namespace

void SourceRules::check(std::span<const PartView> parts, std::uint64_t reached_sheet, std::uint64_t reached_row,
                        bool last) {
    if (finished_) throw std::invalid_argument("a batch came after the worker's last one");
    if (parts.size() != bounds_.size())
        throw std::invalid_argument("a batch has " + std::to_string(parts.size()) + " parts, but there are " +
                                    std::to_string(bounds_.size()) + " regions");
    const MergeKey reached{reached_sheet, reached_row, 0};
    if (!last && (reached.sheet > counts_.sheets || reached.row > counts_.rows))
        throw std::invalid_argument("the batch claims to have reached " + place(reached) + ", beyond the frame");
    std::vector<MergeKey> bounds;
    bounds.reserve(parts.size());
    for (std::size_t region = 0; region < parts.size(); ++region) {
        const MergeKey bound = bound_after(parts[region], bounds_[region]);
        bounds.push_back(!last && reached > bound ? reached : bound);
    }
    bounds_ = std::move(bounds);
    finished_ = last;
}

MergeKey SourceRules::bound_after(const PartView& part, MergeKey bound) const {
    std::uint64_t packets = 0;
    for (std::uint64_t n = 0; n < part.runs.run_count; ++n) {
        const RowRun run = run_at(part.runs.runs, n);
        if (run.count == 0) throw std::invalid_argument(run_name(n, run) + " is empty");
        if (run.sheet >= counts_.sheets || run.row >= counts_.rows ||
            std::uint64_t(run.first) + run.count > counts_.samples)
            throw std::invalid_argument(run_name(n, run) + " with " + std::to_string(run.count) +
                                        " packets leaves the frame's " + std::to_string(counts_.sheets) + " sheets, " +
                                        std::to_string(counts_.rows) + " rows and " + std::to_string(counts_.samples) +
                                        " samples");
        if (key_of(run) < bound)
            throw std::invalid_argument(run_name(n, run) + " comes too late: the worker had reached " + place(bound));
        packets += run.count;
        if (packets > part.packet_count)
            throw std::invalid_argument(run_name(n, run) + " ends at packet " + std::to_string(packets) +
                                        ", but the batch holds " + std::to_string(part.packet_count));
        bound = {run.sheet, run.row, std::uint64_t(run.first) + run.count};
    }
    if (packets != part.packet_count)
        throw std::invalid_argument("the runs hold " + std::to_string(packets) + " packets, the batch " +
                                    std::to_string(part.packet_count));
    return bound;
}

bool SourceRules::finish() { return !finished_.exchange(true); }

}  // namespace volsplat
