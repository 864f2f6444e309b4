// An image cut into stripes of lines, so that threads can share it and the pixels around a run stay in the caches.
#pragma once

#include <vector>

#include "splat_job.h"

namespace volsplat {

// Stripes that hold all lines of an image; `busy` are the lines that most samples reach, to be shared evenly.
std::vector<RowSpan> stripes_of(int lines, RowSpan busy, int footprint_height, int threads);

// A job that stripes of its image pass through one by one, each at its own time and looking at its own runs only.
class StripedJob {
public:
    // The stripes follow each other.
    StripedJob(const SplatJob& job, const std::vector<RowSpan>& stripes);

    // Into the lines of one stripe, by its number.
    SplatOutcome splat(std::size_t stripe) const;

private:
    struct Part {
        RowSpan lines;
        std::vector<SpanView> spans;       // that may reach them
        const unsigned char* packets_end;  // of the last one

        void add(const SpanView& run, const unsigned char* run_packets_end);
    };

    SplatJob job_;
    std::vector<Part> parts_;
};

}  // namespace volsplat
