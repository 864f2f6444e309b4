// The floor under the walk's speed: reading every voxel packet once and doing next to nothing with it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace volsplat {

// The exclusive or of n packets.
std::uint32_t bare_loop(const std::uint32_t* packets, std::size_t n);

}  // namespace volsplat
