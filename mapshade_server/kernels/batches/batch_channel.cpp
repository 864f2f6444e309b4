// Fills the blocks of a channel.
#include "batch_channel.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace volsplat {

namespace {

unsigned char* append(unsigned char* place, const void* from, std::size_t bytes) {
    if (bytes) std::memcpy(place, from, bytes);
    return place + bytes;
}

std::pair<std::uint32_t, std::uint32_t> row_of(const RowRun& run) { return {run.sheet, run.row}; }

}  // namespace

void BatchChannel::begin(std::int64_t frame, std::shared_ptr<const Batch> batch, std::size_t first, std::size_t end) {
    if (first >= end || end > batch->parts.size()) throw std::invalid_argument("the batch has no such parts");
    if ((end - first) * sizeof(PartCounts) > memory_->shape().block_bytes)
        throw std::invalid_argument("a block does not hold the counts of so many regions");
    frame_ = frame, batch_ = std::move(batch), first_ = first;
    next_.assign(end - first, {0, 0});
}

BatchChannel::Sent BatchChannel::send(double seconds) {
    while (batch_) {
        BlockHead& head = memory_->head(walker_, block_);
        const bool free = wait_for_block(head, seconds);
        if (closed_) return Sent::lost;
        if (!free) return Sent::part;
        fill(head, memory_->block(walker_, block_));
        head.state.store(kFilled);
        memory_->filled().ring();
        block_ = (block_ + 1) % memory_->shape().blocks;
    }
    return Sent::all;
}

void BatchChannel::hear_tiles(std::int64_t frame, std::uint64_t* map, std::size_t words) const {
    memory_->tile_news().hear(frame, map, words);
}

void BatchChannel::close() {
    closed_ = true;
    memory_->freed(walker_).ring_anyway();
}

bool BatchChannel::wait_for_block(BlockHead& head, double seconds) {
    using Clock = std::chrono::steady_clock;
    SharedBell& freed = memory_->freed(walker_);
    std::uint32_t heard = freed.rung();
    if (head.state.load() == kFree) return true;
    const Clock::time_point began = Clock::now();
    while (true) {
        const double left = seconds - std::chrono::duration<double>(Clock::now() - began).count();
        if (left > 0) freed.wait(heard, left);
        heard = freed.rung();
        if (head.state.load() == kFree) return true;
        if (left <= 0 || closed_) return false;
    }
}

void BatchChannel::fill(BlockHead& head, unsigned char* block) {
    const std::size_t counted = next_.size() * sizeof(PartCounts);
    const Piece piece = this->piece(memory_->shape().block_bytes - counted);
    unsigned char* place = block + counted;
    for (std::size_t n = 0; n < next_.size(); ++n) {
        const Place from = next_[n], to = piece.ends[n];
        const PartCounts counts{to.run - from.run, to.packet - from.packet};
        append(block + n * sizeof counts, &counts, sizeof counts);
        place = append(place, part(n).runs.data() + from.run, counts.runs * sizeof(RowRun));
        place = append(place, part(n).packets.data() + from.packet, counts.packets * kPacketBytes);
    }
    head.note = {frame_, static_cast<std::uint64_t>(piece.reached_sheet), static_cast<std::uint64_t>(piece.reached_row),
                 next_.size(), piece.last};
    next_ = piece.ends;
    bool whole = true;
    for (std::size_t n = 0; n < next_.size(); ++n) whole &= next_[n].run == part(n).runs.size();
    if (whole) batch_.reset();
}

BatchChannel::Piece BatchChannel::piece(std::size_t bytes) const {
    Piece piece{next_, batch_->reached_sheet, batch_->reached_row, batch_->last};
    std::size_t all = 0;
    for (std::size_t n = 0; n < next_.size(); ++n) {
        all += PartCounts{part(n).runs.size() - next_[n].run, part(n).packet_count - next_[n].packet}.bytes();
        piece.ends[n] = {part(n).runs.size(), part(n).packet_count};
    }
    if (all <= bytes) return piece;
    piece.ends = next_, piece.last = false;
    for (std::size_t left = bytes;;) {
        const Row row = first_row(piece.ends);
        piece.reached_sheet = row.first, piece.reached_row = row.second;
        Places ends = piece.ends;
        std::size_t taken = 0;
        for (std::size_t n = 0; n < next_.size(); ++n) {
            const auto& runs = part(n).runs;
            for (Place& at = ends[n]; at.run < runs.size() && row_of(runs[at.run]) == row; ++at.run) {
                taken += PartCounts{1, runs[at.run].count}.bytes();
                at.packet += runs[at.run].count;
            }
        }
        if (taken > left) {
            if (left == bytes) take_runs(piece.ends, bytes);
            return piece;
        }
        left -= taken;
        piece.ends = std::move(ends);
    }
}

BatchChannel::Row BatchChannel::first_row(const Places& from) const {
    Row row{~0u, ~0u};
    for (std::size_t n = 0; n < from.size(); ++n)
        if (from[n].run < part(n).runs.size()) row = std::min(row, row_of(part(n).runs[from[n].run]));
    return row;
}

void BatchChannel::take_runs(Places& ends, std::size_t bytes) const {
    const Row row = first_row(ends);
    std::size_t left = bytes;
    for (std::size_t n = 0; n < next_.size(); ++n) {
        const auto& runs = part(n).runs;
        for (Place& at = ends[n]; at.run < runs.size() && row_of(runs[at.run]) == row; ++at.run) {
            const std::size_t more = PartCounts{1, runs[at.run].count}.bytes();
            if (more > left) {
                if (left == bytes) throw std::length_error("a block does not hold the longest run");
                return;
            }
            left -= more;
            at.packet += runs[at.run].count;
        }
    }
}

}  // namespace volsplat
