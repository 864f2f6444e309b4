// A walker's end of the channel to a splat server of its machine.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "batch.h"
#include "kernels/channels/batch_channels.h"

namespace volsplat {

// One thread at a time may call, but for close().
class BatchChannel {
public:
    enum class Sent { all, part, lost };

    // Blocks must hold the counts of all regions and the longest run.
    BatchChannel(std::shared_ptr<ChannelMemory> memory, int walker) : memory_(std::move(memory)), walker_(walker) {}

    // That a batch should have: few, so that owners soon have something of each walker, and so few that it fits into a
    // block, with as much room for its runs.
    std::size_t most_packets() const {
        constexpr std::size_t kSoon = 8192;
        return std::min(kSoon, memory_->shape().block_bytes / (2 * kPacketBytes));
    }

    // To be sent next: the batch's parts from `first` to before `end`. What was not sent before never will be.
    void begin(std::int64_t frame, std::shared_ptr<const Batch> batch, std::size_t first, std::size_t end);
    // Sends as much as there is room for, waiting for each block so many seconds at most. What one block does not hold
    // goes on in the next, whole rows first, so that each block has reached the same place of the traversal for all
    // regions, as a batch has.
    Sent send(double seconds);
    // Adds the tiles that the splat server has closed to a map of so many words, if they are of this frame.
    void hear_tiles(std::int64_t frame, std::uint64_t* map, std::size_t words) const;

    // The splat server is lost, which whoever sends hears. From any thread.
    void close();

private:
    struct Place {  // in a part
        std::size_t run, packet;
    };
    typedef std::vector<Place> Places;                    // in each part
    typedef std::pair<std::uint32_t, std::uint32_t> Row;  // its sheet, and itself
    struct Piece {
        Places ends;
        std::int64_t reached_sheet, reached_row;
        bool last;
    };

    bool wait_for_block(BlockHead& head, double seconds);
    void fill(BlockHead& head, unsigned char* block);
    // What comes next in so many bytes.
    Piece piece(std::size_t bytes) const;
    // Of what comes from these places on.
    Row first_row(const Places& from) const;
    // Within a row that is longer than a block.
    void take_runs(Places& ends, std::size_t bytes) const;
    const ShadedPart& part(std::size_t number) const { return batch_->parts[first_ + number]; }

    const std::shared_ptr<ChannelMemory> memory_;
    const int walker_;
    std::atomic<bool> closed_{false};
    int block_ = 0;  // to be filled next
    std::int64_t frame_ = -1;
    std::shared_ptr<const Batch> batch_;
    std::size_t first_ = 0;
    Places next_;
};

}  // namespace volsplat
