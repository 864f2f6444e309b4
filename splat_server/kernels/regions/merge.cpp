#include "merge.h"

#include <utility>

namespace volsplat {

SortedBuffers::SortedBuffers(int sources) : sources_(sources) {
    for (int source = 0; source < sources; ++source) link(source);
}

void SortedBuffers::push(Arrival arrival) {
    Source& source = sources_[arrival.source];
    const bool waited = source.buffers.empty();
    if (waited) unlink(arrival.source);  // else it stands at its first run still
    source.bound = arrival.bound;
    source.finished = arrival.last;
    if (arrival.runs.run_count) source.buffers.push_back({arrival.runs, std::move(arrival.memory)});
    if (waited) link(arrival.source);
}

std::uint64_t SortedBuffers::advance(std::uint64_t max_packets, std::vector<SpanView>& spans,
                                     std::vector<std::shared_ptr<const void>>& spent) {
    std::uint64_t packets = 0;
    while (head_ >= 0 && waits_for() < 0 && packets < max_packets) {
        const int number = head_;
        Source& source = sources_[number];
        unlink(number);
        spans.push_back(cut(source, max_packets, packets));
        if (source.buffers.front().left.run_count == 0) {
            spent.push_back(std::move(source.buffers.front().memory));
            source.buffers.pop_front();
        }
        link(number);
    }
    return packets;
}

// The runs of its first buffer that come before the head of the list. The first one always does, so that equal keys
// cannot stop the merge.
SpanView SortedBuffers::cut(Source& source, std::uint64_t max_packets, std::uint64_t& packets) const {
    SpanView& left = source.buffers.front().left;
    SpanView span{left.runs, left.packets, 0};
    do {
        const RowRun run = run_at(left.runs, 0);
        if (span.run_count && head_ >= 0 && key_of(run) > sources_[head_].key) break;
        ++span.run_count;
        packets += run.count;
        left.runs += sizeof(RowRun);
        left.packets += std::uint64_t(run.count) * kPacketBytes;
        --left.run_count;
    } while (left.run_count && packets < max_packets);
    return span;
}

int SortedBuffers::waits_for() const { return head_ >= 0 && sources_[head_].buffers.empty() ? head_ : -1; }

// An empty source goes behind a run of the same key: two sources never hold the same sample.
bool SortedBuffers::goes_before(int a, int b) const {
    const MergeKey &of_a = sources_[a].key, &of_b = sources_[b].key;
    if (of_a != of_b) return of_a < of_b;
    const bool a_waits = sources_[a].buffers.empty(), b_waits = sources_[b].buffers.empty();
    return a_waits != b_waits ? b_waits : a < b;
}

void SortedBuffers::unlink(int number) {
    const Source& source = sources_[number];
    (source.before < 0 ? head_ : sources_[source.before].next) = source.next;
    (source.next < 0 ? tail_ : sources_[source.next].before) = source.before;
}

// Mostly near an end of the list: sources that take turns go behind all others, and those of a part of the volume that
// comes before all others stay in front of them.
void SortedBuffers::link(int number) {
    Source& source = sources_[number];
    if (source.buffers.empty() && source.finished) {  // nothing more from it
        source.before = source.next = -1;
        return;
    }
    source.key = source.buffers.empty() ? source.bound : key_of(run_at(source.buffers.front().left.runs, 0));
    int next = head_, before = tail_;
    if (tail_ >= 0 && goes_before(tail_, number)) {
        next = -1;
    } else {
        while (next >= 0 && goes_before(next, number)) next = sources_[next].next;
        before = next < 0 ? tail_ : sources_[next].before;
    }
    source.before = before, source.next = next;
    (before < 0 ? head_ : sources_[before].next) = number;
    (next < 0 ? tail_ : sources_[next].before) = number;
}

}  // namespace volsplat
