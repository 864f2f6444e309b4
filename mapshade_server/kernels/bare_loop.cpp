// Written so that the compiler makes vectors of it.
#include "bare_loop.h"

namespace volsplat {

std::uint32_t bare_loop(const std::uint32_t* packets, std::size_t n) {
  std::uint32_t all = 0;
  for (std::size_t at = 0; at < n; ++at) all ^= packets[at];
  return all;
}

}  // namespace volsplat
