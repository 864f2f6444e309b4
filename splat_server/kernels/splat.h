// The hot loops on the chosen CPU path.
#pragma once
#include "footprint_box.h"
#include "splat_job.h"

namespace volsplat {

// Splats spans of merged runs into rows of the image.
SplatOutcome splat(const SplatJob& job);

// Writes the rows of pixels that each run of the job reaches.
void find_run_rows(const SplatJob& job, RowSpan* rows);

// Writes [offsets y][offsets x][height][pitch] weights into zeros.
void fill_footprints(const FootprintBox& box, float* weights);

}  // namespace volsplat
