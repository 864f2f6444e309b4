// Byte by byte the lesser and the greater of two.
#include "kernels/compiler.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

void least(const std::uint8_t* other, std::size_t n, std::uint8_t* bytes) {
    VOLSPLAT_INDEPENDENT
    for (std::size_t at = 0; at < n; ++at) bytes[at] = bytes[at] < other[at] ? bytes[at] : other[at];
}

void greatest(const std::uint8_t* other, std::size_t n, std::uint8_t* bytes) {
    VOLSPLAT_INDEPENDENT
    for (std::size_t at = 0; at < n; ++at) bytes[at] = bytes[at] < other[at] ? other[at] : bytes[at];
}

}  // namespace volsplat::VOLSPLAT_PATH
