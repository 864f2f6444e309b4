#include "large_memory.h"

#include <cstdlib>
#include <cstring>
#include <new>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace volsplat {
namespace {

constexpr std::size_t kLine = 64, kLargePage = std::size_t(1) << 21;
constexpr std::size_t kLargeFrom = kLargePage / 4;  // below, most of a large page would be wasted

}  // namespace

void FreeMemory::operator()(float* memory) const { std::free(memory); }

LargeMemory large_memory(std::size_t floats) {
    const std::size_t alignment = floats * sizeof(float) < kLargeFrom ? kLine : kLargePage;
    const std::size_t bytes = (floats * sizeof(float) + alignment - 1) & ~(alignment - 1);
    LargeMemory memory(static_cast<float*>(std::aligned_alloc(alignment, bytes)));
    if (!memory) throw std::bad_alloc();
#ifdef __linux__
    if (alignment == kLargePage) madvise(memory.get(), bytes, MADV_HUGEPAGE);  // a wish; it works without
#endif
    std::memset(memory.get(), 0, floats * sizeof(float));
    return memory;
}

}  // namespace volsplat
