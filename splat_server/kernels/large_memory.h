// Memory for what is written to and read from all over: on large pages where the system has them, since the rows of
// one footprint lie on more pages of the usual size than the processor keeps addresses of.
#pragma once
#include <cstddef>
#include <memory>

namespace volsplat {

struct FreeMemory {
    void operator()(float* memory) const;
};
using LargeMemory = std::unique_ptr<float[], FreeMemory>;

// Zeros, 64-byte aligned at least. Throws std::bad_alloc.
LargeMemory large_memory(std::size_t floats);

}  // namespace volsplat
