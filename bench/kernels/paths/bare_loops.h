// The floors of `volsplat bench kernels`: the kernels' work with everything else taken away.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/path_table.h"

namespace volsplat {

// Tables of the map/shade floor; colours are r, g, b and one unused, in levels of 8 bits.
struct BareTables {
    const std::uint16_t* opacity;  // 65536 codes, by the lower 16 bits of a voxel packet
    const float* emit;             // 256 x 4, by density
    const float* refl;             // 256 x 4, by density
    const float* light;            // 32768, by direction code
};

// The loops of one instruction set.
struct BareLoops {
    // Fused weighted adds of one sample to boxes of `side` x `side` pixels, RGBA, back to front. `corners` are their
    // top left pixels (x, y); `weights` are given for each channel.
    Kernel<void(float* image, std::int64_t pitch, const std::int32_t* corners, std::int64_t count, int side,
                const float* weights, const float* sample)>
        splat;

    // Writes 64 bits for each visible packet, opacity code and colour, and says how many; `shaded` has room for all.
    Kernel<std::int64_t(const std::uint32_t* packets, std::int64_t count, const BareTables& tables,
                        std::uint64_t* shaded)>
        shade;
};

// Those of the CPU path in use.
const BareLoops& bare_loops();

}  // namespace volsplat

#if defined(VOLSPLAT_PATH)
namespace volsplat::VOLSPLAT_PATH {

FunctionOf<&BareLoops::splat> bare_splat;
FunctionOf<&BareLoops::shade> bare_shade;

}  // namespace volsplat::VOLSPLAT_PATH
#endif
