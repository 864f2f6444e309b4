// The sorted linked list of the sources' packet buffers (paper: "Parallel Implementation"): of each region one.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <vector>

#include "splat_server/kernels/splat_job.h"

namespace volsplat {

struct MergeKey {
    std::uint64_t sheet, row, first;
    auto operator<=>(const MergeKey&) const = default;
};

inline MergeKey key_of(const RowRun& run) { return {run.sheet, run.row, run.first}; }

// What a source has handed out for the region, and checked.
struct Arrival {
    int source;
    SpanView runs;
    std::shared_ptr<const void> memory;  // that they lie in
    MergeKey bound;                      // no later run lies before it
    bool last;                           // nothing comes later
};

class SortedBuffers {
public:
    explicit SortedBuffers(int sources);

    void push(Arrival arrival);
    // Appends spans of runs in the order of (sheet, row, first) as far as it is decided, until so many packets are
    // passed, and the memory that is not needed any more once they are splatted. Returns how many packets.
    std::uint64_t advance(std::uint64_t max_packets, std::vector<SpanView>& spans,
                          std::vector<std::shared_ptr<const void>>& spent);

    // The source without which it cannot go on; -1 if the next run is there, or all is complete.
    int waits_for() const;
    // Nothing may come any more and nothing is left.
    bool complete() const { return head_ < 0; }
    // All that lies before it has been passed; of buffers that are not complete.
    const MergeKey& reached() const { return sources_[head_].key; }

private:
    struct Buffer {
        SpanView left;  // at least one run
        std::shared_ptr<const void> memory;
    };
    struct Source {
        std::deque<Buffer> buffers;
        MergeKey bound{0, 0, 0};
        bool finished = false;
        MergeKey key{0, 0, 0};  // where it stands in the list: its first run or, with none, what may still come
        int before = -1, next = -1;
    };

    bool goes_before(int a, int b) const;
    void unlink(int source);
    void link(int source);
    SpanView cut(Source& source, std::uint64_t max_packets, std::uint64_t& packets) const;

    std::vector<Source> sources_;
    int head_ = -1, tail_ = -1;
};

}  // namespace volsplat
