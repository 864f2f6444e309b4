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

std::size_t heads_bytes(const ChannelShape& shape) {
    const std::size_t bytes = bells_bytes(shape) + std::size_t(shape.walkers) * shape.blocks * sizeof(BlockHead);
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
    return heads_bytes(shape) + std::size_t(shape.walkers) * shape.blocks * shape.block_bytes;
}

SharedBell* ChannelMemory::bell(std::size_t number) const {
    return reinterpret_cast<SharedBell*>(memory_ + number * kLine);
}

BlockHead& ChannelMemory::head(int walker, int block) const {
    const std::size_t number = std::size_t(walker) * shape_.blocks + block;
    return reinterpret_cast<BlockHead*>(memory_ + bells_bytes(shape_))[number];
}

unsigned char* ChannelMemory::block(int walker, int block) const {
    const std::size_t number = std::size_t(walker) * shape_.blocks + block;
    return memory_ + heads_bytes(shape_) + number * shape_.block_bytes;
}

}  // namespace volsplat
