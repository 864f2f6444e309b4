// Asks the system for large pages, and has the allocator give memory back.
#include "memory.h"

#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif
#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace volsplat {

namespace {

constexpr std::size_t kLargePage = std::size_t{2} << 20;
constexpr std::size_t kCacheLine = 64;

}  // namespace

LargeMemory large_memory(std::size_t bytes) {
  const std::size_t page = bytes >= kLargePage ? kLargePage : kCacheLine;
  const std::size_t rounded = (bytes / page + 1) * page;
  LargeMemory memory(std::aligned_alloc(page, rounded));
  if (!memory) throw std::bad_alloc();
#if defined(__linux__)
  if (page == kLargePage) static_cast<void>(madvise(memory.get(), rounded, MADV_HUGEPAGE));  // only a hint
#endif
  return memory;
}

void give_freed_memory_back() {
#if defined(__GLIBC__)
  mallopt(M_MMAP_THRESHOLD, 1 << 18);
#endif
}

}  // namespace volsplat
