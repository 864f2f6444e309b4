// What the dispatcher calls: the same functions once for each instruction set, each in its own namespace.
#pragma once
#include "../footprint_box.h"
#include "../splat_job.h"

namespace volsplat {
namespace baseline {
SplatOutcome splat(const SplatJob& job);
void find_run_rows(const SplatJob& job, RowSpan* rows);
void fill_footprints(const FootprintBox& box, float* weights);
}
namespace avx2 {
SplatOutcome splat(const SplatJob& job);
void find_run_rows(const SplatJob& job, RowSpan* rows);
void fill_footprints(const FootprintBox& box, float* weights);
}
namespace avx512 {
SplatOutcome splat(const SplatJob& job);
void find_run_rows(const SplatJob& job, RowSpan* rows);
void fill_footprints(const FootprintBox& box, float* weights);
}
}  // namespace volsplat
