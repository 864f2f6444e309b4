// Lays out the memory of channels.
#include "batch_channels.h"

#include <sys/mman.h>

#include <cerrno>
#include <system_error>

namespace volsplat {

namespace {

constexpr std::size_t kLine = 64;  // a cache line for each bell and head, against false sharing
constexpr std::size_t kBlockAlignment = 1 << 16;

std::size_t bells_bytes(const ChannelShape& shape) { return (1 + std::size_t(shape.walkers)) * kLine; }

std::size_t news_begin(const ChannelShape& shape) {
    return bells_bytes(shape) + std::size_t(shape.walkers) * shape.blocks * sizeof(BlockHead);
}

std::size_t blocks_begin(const ChannelShape& shape) {
    const std::size_t bytes = news_begin(shape) + sizeof(TileNews);
    return (bytes + kBlockAlignment - 1) / kBlockAlignment * kBlockAlignment;
}

unsigned char* mapped(int descriptor, std::size_t bytes) {
    void* const memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (memory == MAP_FAILED) throw std::system_error(errno, std::generic_category(), "mmap");
    return static_cast<unsigned char*>(memory);
}

}  // namespace

ChannelMemory::ChannelMemory(int descriptor, const ChannelShape& shape)
    : shape_(shape), memory_(mapped(descriptor, bytes(shape))) {}

ChannelMemory::~ChannelMemory() { ::munmap(memory_, bytes(shape_)); }

std::size_t ChannelMemory::bytes(const ChannelShape& shape) {
    return blocks_begin(shape) + std::size_t(shape.walkers) * shape.blocks * shape.block_bytes;
}

SharedBell* ChannelMemory::bell(std::size_t number) const {
    return reinterpret_cast<SharedBell*>(memory_ + number * kLine);
}

TileNews& ChannelMemory::tile_news() const { return *reinterpret_cast<TileNews*>(memory_ + news_begin(shape_)); }

BlockHead& ChannelMemory::head(int walker, int block) const {
    const std::size_t number = std::size_t(walker) * shape_.blocks + block;
    return reinterpret_cast<BlockHead*>(memory_ + bells_bytes(shape_))[number];
}

unsigned char* ChannelMemory::block(int walker, int block) const {
    const std::size_t number = std::size_t(walker) * shape_.blocks + block;
    return memory_ + blocks_begin(shape_) + number * shape_.block_bytes;
}

}  // namespace volsplat
