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

}  // namespace volsplat
