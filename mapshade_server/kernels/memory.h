// Memory for millions of numbers, on large pages where the system has them: rows along j or k would otherwise miss
// the TLB at every sample.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>

namespace volsplat {

struct FreeMemory {
  void operator()(void* memory) const { std::free(memory); }
};

using LargeMemory = std::unique_ptr<void, FreeMemory>;

// Uninitialised, aligned for vectors. The system hands out its pages as they are touched. Throws std::bad_alloc.
LargeMemory large_memory(std::size_t bytes);

// From now on the system gets memory of a quarter of a megabyte and more back as soon as it is freed. The allocator of
// glibc would come to keep it, once for every thread that asked for such.
void give_freed_memory_back();

}  // namespace volsplat
