// An image cut into stripes of lines, so that threads can share it and the pixels around a run stay in the caches.
#pragma once
#include <vector>

#include "splat_job.h"

namespace volsplat {

// Stripes that hold all lines of an image; `busy` are the lines that most samples reach, to be shared evenly.
std::vector<RowSpan> stripes_of(int lines, RowSpan busy, int footprint_height, int threads);

// A job that stripes of its image pass through one by one, each at its own time.
class StripedJob {
public:
    StripedJob(const SplatJob& job, int stripes);

    // Into the lines of one stripe.
    SplatOutcome splat(RowSpan stripe) const;

private:
    bool reaches(RowSpan stripe) const;

    SplatJob job_;
    std::vector<RowSpan> run_rows_;  // of each run, unless there is but one stripe
    RowSpan reached_;                // by any run
};

}  // namespace volsplat
