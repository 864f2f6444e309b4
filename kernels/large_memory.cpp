#include "kernels/large_memory.h"

#include <cstring>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif
#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace volsplat {

namespace {

constexpr std::size_t kCacheLine = 64, kLargePage = std::size_t{2} << 20;
constexpr std::size_t kLargeFrom = kLargePage / 4;  // below, most of a large page would be wasted

}  // namespace

void* large_memory(std::size_t bytes) {
    const std::size_t alignment = bytes < kLargeFrom ? kCacheLine : kLargePage;
    const std::size_t rounded = (bytes / alignment + 1) * alignment;
    void* memory = std::aligned_alloc(alignment, rounded);
    if (!memory) throw std::bad_alloc();
#if defined(__linux__)
    if (alignment == kLargePage) static_cast<void>(madvise(memory, rounded, MADV_HUGEPAGE));  // a wish; works without
#endif
    return memory;
}

LargeArray<float> zeros(std::size_t count) {
    LargeArray<float> floats = large_array<float>(count);
    std::memset(floats.get(), 0, count * sizeof(float));
    return floats;
}

void give_freed_memory_back() {
#if defined(__GLIBC__)
    mallopt(M_MMAP_THRESHOLD, 1 << 18);
#endif
}

}  // namespace volsplat
