// What the dispatcher calls: the same function once for each instruction set, each in its own namespace.
#pragma once
#include "../splat_job.h"

namespace volsplat {
namespace baseline {
void splat(const SplatJob& job);
}
namespace avx2 {
void splat(const SplatJob& job);
}
namespace avx512 {
void splat(const SplatJob& job);
}
}  // namespace volsplat
