// The map/shade kernel's floor: read every voxel packet, look one table up, shade the visible ones.
#include "bare_loops.h"

namespace volsplat::VOLSPLAT_PATH {

typedef float Colour __attribute__((vector_size(16)));
typedef std::int32_t Levels __attribute__((vector_size(16)));

std::int64_t bare_shade(const std::uint32_t* packets, std::int64_t count, const BareTables& tables,
                        std::uint64_t* shaded) {
    constexpr std::int64_t kBlock = 1024;
    std::uint32_t visible[kBlock];
    std::uint64_t* out = shaded;
    for (std::int64_t first = 0; first < count; first += kBlock) {
        const std::int64_t end = first + kBlock < count ? first + kBlock : count;
        std::int64_t found = 0;
        for (std::int64_t n = first; n < end; ++n) {  // without a branch, which visibility would mispredict
            visible[found] = packets[n];
            found += tables.opacity[packets[n] & 0xffff] != 0;
        }
        for (std::int64_t n = 0; n < found; ++n) {
            const std::uint32_t packet = visible[n];
            Colour emit, refl;
            __builtin_memcpy(&emit, tables.emit + 4 * (packet & 255), sizeof emit);
            __builtin_memcpy(&refl, tables.refl + 4 * (packet & 255), sizeof refl);
            const Colour lit = emit + refl * tables.light[packet >> 16 & 0x7fff];
            const Levels levels = __builtin_convertvector(lit < 255.0f ? lit : Colour{} + 255.0f, Levels);
            *out++ = std::uint64_t(tables.opacity[packet & 0xffff]) << 28 | std::uint64_t(levels[0]) << 40 |
                     std::uint64_t(levels[1]) << 48 | std::uint64_t(levels[2]) << 56;
        }
    }
    return out - shaded;
}

}  // namespace volsplat::VOLSPLAT_PATH
