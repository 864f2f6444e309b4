// The sorted linked list of the map/shade servers' packet buffers (paper: "Parallel Implementation").
// It knows no sockets and no Python: buffers are addresses that the caller keeps alive until they are released.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "splat_job.h"

namespace volsplat {

struct MergeSpan {  // consecutive runs of one batch, in their place in the frame's one sequence
    std::uint64_t batch, first_run, run_count, first_packet, packet_count;
    SpanView view;
};

struct MergeProgress {
    std::vector<MergeSpan> spans;
    std::vector<std::uint64_t> released;  // batches whose last run is among the spans, or was before
    std::uint64_t packets = 0;
    int waits_for = -1;     // the worker whose next batch is needed to go on
    bool complete = false;  // nothing may come any more and nothing is left
};

class SortedBuffers {
public:
    // `counts` are the visited samples along sheet, row and sample; keys are ordinals below them.
    SortedBuffers(int workers, std::uint64_t sheets, std::uint64_t rows, std::uint64_t samples);

    // Appends a batch to a worker's buffer list; nothing to come from it lies before (reached_sheet, reached_row).
    // Throws std::invalid_argument naming the fault, and takes nothing, where the batch breaks the rules.
    void push(int worker, std::uint64_t batch, const unsigned char* runs, std::uint64_t run_count,
              const unsigned char* packets, std::uint64_t packet_count, std::uint64_t reached_sheet,
              std::uint64_t reached_row, bool last);
    // Nothing more will come from the worker. What it has sent is still merged.
    void finish(int worker);
    // Emits runs in the order of (sheet, row, first) as far as it is decided, until `max_packets` are passed.
    MergeProgress advance(std::uint64_t max_packets);
    // Throws std::logic_error where the list or the buffers break an invariant.
    void validate() const;

    int waits_for() const;  // -1 where the next run is there, or all is complete
    bool complete() const;

private:
    struct Key {
        std::uint64_t sheet, row, first;
        auto operator<=>(const Key&) const = default;
    };
    struct Buffer {
        std::uint64_t batch;
        const unsigned char* runs;
        std::uint64_t run_count;
        const unsigned char* packets;
        std::uint64_t next_run = 0, next_packet = 0;
    };
    struct Worker {
        std::deque<Buffer> buffers;  // each with runs left
        Key bound{0, 0, 0};          // no later run lies before it
        bool finished = false;
        int next = -1;  // in the sorted linked list
        bool linked = false;
    };

    // Where the worker stands in the list: its first waiting run or, with none, what may still come.
    Key head_key(const Worker& worker) const;
    // An empty worker goes behind a run of the same key: two workers never hold the same sample.
    bool goes_before(int a, int b) const;
    void unlink(int worker);
    void link(int worker);

    std::uint64_t sheets_, rows_, samples_;
    std::vector<Worker> workers_;
    std::vector<std::uint64_t> spent_;  // batches to report as released
    int head_ = -1;
};

}  // namespace volsplat
