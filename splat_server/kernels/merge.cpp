#include "merge.h"

#include <stdexcept>
#include <string>

namespace volsplat {

namespace {

std::string place(std::uint64_t sheet, std::uint64_t row, std::uint64_t first) {
    return "(sheet " + std::to_string(sheet) + ", row " + std::to_string(row) + ", sample " + std::to_string(first) +
           ")";
}

}  // namespace

SortedBuffers::SortedBuffers(int workers, std::uint64_t sheets, std::uint64_t rows, std::uint64_t samples)
    : sheets_(sheets), rows_(rows), samples_(samples) {
    if (workers < 0) throw std::invalid_argument("a merge needs a number of workers");
    workers_.resize(workers);
    for (int worker = workers - 1; worker >= 0; --worker) link(worker);
}

void SortedBuffers::push(int number, std::uint64_t batch, const unsigned char* runs, std::uint64_t run_count,
                         const unsigned char* packets, std::uint64_t packet_count, std::uint64_t reached_sheet,
                         std::uint64_t reached_row, bool last) {
    if (number < 0 || number >= static_cast<int>(workers_.size()))
        throw std::invalid_argument("worker " + std::to_string(number) + " is not part of this frame");
    Worker& worker = workers_[number];
    if (worker.finished) throw std::invalid_argument("a batch came after the worker's last one");

    // Check every run before anything changes, since the peer may be broken or hostile.
    Key bound = worker.bound;
    std::uint64_t packets_seen = 0;
    for (std::uint64_t n = 0; n < run_count; ++n) {
        const RowRun run = run_at(runs, n);
        const Key key{run.sheet, run.row, run.first};
        const auto which = [&] { return "run " + std::to_string(n) + " at " + place(run.sheet, run.row, run.first); };
        if (run.count == 0) throw std::invalid_argument(which() + " is empty");
        if (run.sheet >= sheets_ || run.row >= rows_ || std::uint64_t(run.first) + run.count > samples_)
            throw std::invalid_argument(which() + " with " + std::to_string(run.count) +
                                        " packets leaves the frame's " + std::to_string(sheets_) + " sheets, " +
                                        std::to_string(rows_) + " rows and " + std::to_string(samples_) + " samples");
        if (key < bound)
            throw std::invalid_argument(which() + " comes too late: the worker had reached " +
                                        place(bound.sheet, bound.row, bound.first));
        packets_seen += run.count;
        if (packets_seen > packet_count)
            throw std::invalid_argument(which() + " ends at packet " + std::to_string(packets_seen) +
                                        ", but the batch holds " + std::to_string(packet_count));
        bound = {key.sheet, key.row, key.first + run.count};
    }
    if (packets_seen != packet_count)
        throw std::invalid_argument("the runs hold " + std::to_string(packets_seen) + " packets, the batch " +
                                    std::to_string(packet_count));
    const Key reached{reached_sheet, reached_row, 0};
    if (!last) {
        if (reached_sheet > sheets_ || reached_row > rows_)
            throw std::invalid_argument("the batch claims to have reached " + place(reached_sheet, reached_row, 0) +
                                        ", beyond the frame");
        if (reached > bound) bound = reached;
    }

    unlink(number);
    worker.bound = bound;
    worker.finished = last;
    if (run_count) worker.buffers.push_back({batch, runs, run_count, packets});
    else spent_.push_back(batch);
    link(number);
}

void SortedBuffers::finish(int number) {
    if (number < 0 || number >= static_cast<int>(workers_.size()))
        throw std::invalid_argument("worker " + std::to_string(number) + " is not part of this frame");
    unlink(number);
    workers_[number].finished = true;
    link(number);
}

MergeProgress SortedBuffers::advance(std::uint64_t max_packets) {
    MergeProgress progress;
    while (waits_for() < 0 && head_ >= 0 && progress.packets < max_packets) {
        const int number = head_;
        Worker& worker = workers_[number];
        unlink(number);
        // Everything of its first buffer that comes before the second worker of the list.
        const Key limit = head_ >= 0 ? head_key(workers_[head_]) : Key{sheets_, rows_, samples_};
        Buffer& buffer = worker.buffers.front();
        MergeSpan span{buffer.batch, buffer.next_run, 0, buffer.next_packet, 0, {}};
        span.view.runs = buffer.runs + buffer.next_run * sizeof(RowRun);
        span.view.packets = buffer.packets + buffer.next_packet * kPacketBytes;
        do {
            const RowRun run = run_at(buffer.runs, buffer.next_run);
            // The head of the list always goes first, so that equal keys cannot stop the merge.
            if (span.run_count && Key{run.sheet, run.row, run.first} > limit) break;
            ++buffer.next_run;
            buffer.next_packet += run.count;
            span.packet_count += run.count;
            ++span.run_count;
        } while (buffer.next_run < buffer.run_count && progress.packets + span.packet_count < max_packets);
        span.view.run_count = span.run_count;
        progress.packets += span.packet_count;
        progress.spans.push_back(span);
        if (buffer.next_run == buffer.run_count) {
            spent_.push_back(buffer.batch);
            worker.buffers.pop_front();
        }
        link(number);
    }
    progress.released.swap(spent_);
    progress.waits_for = waits_for();
    progress.complete = complete();
    return progress;
}

int SortedBuffers::waits_for() const { return head_ >= 0 && workers_[head_].buffers.empty() ? head_ : -1; }

bool SortedBuffers::complete() const { return head_ < 0; }

SortedBuffers::Key SortedBuffers::head_key(const Worker& worker) const {
    if (worker.buffers.empty()) return worker.bound;
    const Buffer& buffer = worker.buffers.front();
    const RowRun run = run_at(buffer.runs, buffer.next_run);
    return {run.sheet, run.row, run.first};
}

bool SortedBuffers::goes_before(int a, int b) const {
    const Key of_a = head_key(workers_[a]), of_b = head_key(workers_[b]);
    if (of_a != of_b) return of_a < of_b;
    const bool a_waits = workers_[a].buffers.empty(), b_waits = workers_[b].buffers.empty();
    return a_waits != b_waits ? b_waits : a < b;
}

void SortedBuffers::unlink(int number) {
    if (!workers_[number].linked) return;
    int* link = &head_;
    while (*link >= 0 && *link != number) link = &workers_[*link].next;
    if (*link == number) *link = workers_[number].next;
    workers_[number].linked = false;
    workers_[number].next = -1;
}

void SortedBuffers::link(int number) {
    Worker& worker = workers_[number];
    if (worker.finished && worker.buffers.empty()) {  // nothing more from it
        worker.linked = false;
        return;
    }
    int* link = &head_;
    while (*link >= 0 && goes_before(*link, number)) link = &workers_[*link].next;
    worker.next = *link;
    worker.linked = true;
    *link = number;
}

void SortedBuffers::validate() const {
    std::vector<bool> seen(workers_.size());
    for (int at = head_, before = -1; at >= 0; before = at, at = workers_[at].next) {
        if (seen[at]) throw std::logic_error("the linked list has a loop");
        seen[at] = true;
        if (!workers_[at].linked) throw std::logic_error("an unlinked worker is in the list");
        if (before >= 0 && goes_before(at, before)) throw std::logic_error("the linked list is not sorted");
    }
    for (std::size_t n = 0; n < workers_.size(); ++n) {
        const Worker& worker = workers_[n];
        if (worker.linked != seen[n]) throw std::logic_error("a linked worker is not in the list");
        if (!worker.linked && !(worker.finished && worker.buffers.empty()))
            throw std::logic_error("a worker that may still send is not in the list");
        for (const Buffer& buffer : worker.buffers)
            if (buffer.next_run >= buffer.run_count) throw std::logic_error("a spent buffer was kept");
    }
}

}  // namespace volsplat
