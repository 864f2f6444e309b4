// A walker's end of the channel to a splat server of its machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "batch.h"
#include "kernels/channels/batch_channels.h"

namespace volsplat {

// One thread at a time may call.
class BatchChannel {
public:
    // Blocks must hold the counts of all regions and the longest run.
    BatchChannel(std::shared_ptr<ChannelMemory> memory, int walker) : memory_(std::move(memory)), walker_(walker) {}

    // To be sent next: the batch's parts from `first` to before `end`. What was not sent before never will be.
    void begin(std::int64_t frame, std::shared_ptr<const Batch> batch, std::size_t first, std::size_t end);
    // Sends as much as there is room for, waiting for each block so many seconds at most. True once all has gone. What
    // one block does not hold goes on in the next, whole rows first, so that each block has reached the same place of
    // the traversal for all regions, as a batch has.
    bool send(double seconds);

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
    int block_ = 0;  // to be filled next
    std::int64_t frame_ = -1;
    std::shared_ptr<const Batch> batch_;
    std::size_t first_ = 0;
    Places next_;
};

}  // namespace volsplat
