// Splats spans of merged runs into the image on the chosen CPU path.
#pragma once
#include "splat_job.h"

namespace volsplat {

void splat(const SplatJob& job);

}  // namespace volsplat
