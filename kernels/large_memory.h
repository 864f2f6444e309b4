// Memory for millions of numbers, on large pages if the system has them: rows of voxels along j or k, and those of one
// footprint, lie on more pages of the usual size than the processor keeps addresses of.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>

namespace volsplat {

struct FreeMemory {
    void operator()(void* memory) const { std::free(memory); }
};

template <class Number>
using LargeArray = std::unique_ptr<Number[], FreeMemory>;

// Uninitialised, aligned to cache lines at least. The system hands out its pages as they are touched. Throws
// std::bad_alloc.
void* large_memory(std::size_t bytes);

template <class Number>
LargeArray<Number> large_array(std::size_t count) {
    return LargeArray<Number>(static_cast<Number*>(large_memory(count * sizeof(Number))));
}

// Zeros.
LargeArray<float> zeros(std::size_t count);

// From now on the system gets memory of a quarter of a megabyte and more back as soon as it is freed. The allocator of
// glibc would come to keep it, once for every thread that asked for such.
void give_freed_memory_back();

}  // namespace volsplat
