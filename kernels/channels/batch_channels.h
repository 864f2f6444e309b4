// The memory that a map/shade server's batches go through to a splat server of its machine, as both see it, and by
// which news of closed tiles come back.
//
// Each walker has a channel: blocks that it fills in turn, and that the splat server takes in that order and frees in
// any order. A walker waits for no block but its own, so that one which is ahead cannot keep another from going on:
// what the walker furthest behind has sent is splatted without anything more being read, and its blocks are freed.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "kernels/packet_layout.h"
#include "shared_bell.h"
#include "tile_news.h"

namespace volsplat {

struct ChannelShape {
    int walkers;
    int blocks;  // of each walker
    std::size_t block_bytes;
};

struct BatchNote {  // of what a block holds: for each region its counts, then for each its row runs and its packets
    std::int64_t frame;
    std::uint64_t reached_sheet, reached_row;  // all that the walker has before it has been sent
    std::uint64_t regions;
    std::uint64_t last;  // nothing of the frame follows
};

struct PartCounts {
    std::uint64_t runs, packets;
    std::uint64_t bytes() const { return runs * sizeof(RowRun) + packets * kPacketBytes; }
};

enum BlockState : std::uint32_t { kFree, kFilled, kTaken };  // the walker fills, the splat server takes and frees

struct alignas(64) BlockHead {
    std::atomic<std::uint32_t> state;
    BatchNote note;  // of a filled block
};

// The memory as one process has it. Zeros are channels with nothing in them.
class ChannelMemory {
public:
    // Maps the memory of a descriptor, which stays open. Throws std::system_error.
    ChannelMemory(int descriptor, const ChannelShape& shape);
    ~ChannelMemory();
    ChannelMemory(const ChannelMemory&) = delete;
    ChannelMemory& operator=(const ChannelMemory&) = delete;

    // What a shape takes.
    static std::size_t bytes(const ChannelShape& shape);

    const ChannelShape& shape() const { return shape_; }
    SharedBell& filled() const { return *bell(0); }  // any block
    SharedBell& freed(int walker) const { return *bell(1 + walker); }
    TileNews& tile_news() const;
    BlockHead& head(int walker, int block) const;
    unsigned char* block(int walker, int block) const;

private:
    SharedBell* bell(std::size_t number) const;

    const ChannelShape shape_;
    unsigned char* const memory_;
};

}  // namespace volsplat
