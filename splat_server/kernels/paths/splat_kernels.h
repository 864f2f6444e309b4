// The hot loops that exist once for each instruction set.
#pragma once

#include "kernels/path_table.h"
#include "splat_server/kernels/footprint_box.h"
#include "splat_server/kernels/slab_sums.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat {

// The kernels of one instruction set.
struct SplatKernels {
    // Splats spans of merged runs into rows of the image.
    Kernel<SplatOutcome(const SplatJob& job)> splat;

    // Writes [offsets y][offsets x][height][pitch] weights into zeros.
    Kernel<void(const FootprintBox& box, float* weights)> fill_footprints;

    // Add runs of voxels to the planes of a frame of slabs, in sums of 32 and of 64 bits; return how many are hidden.
    Kernel<std::uint64_t(const SlabTableView& table, const SlabSums& sums, const ImageView& image,
                         const SlabRuns& runs)>
        splat_slabs, splat_wide_slabs;
};

// Those of the CPU path in use.
const SplatKernels& splat_kernels();

}  // namespace volsplat

#if defined(VOLSPLAT_PATH)
namespace volsplat::VOLSPLAT_PATH {

FunctionOf<&SplatKernels::splat> splat;
FunctionOf<&SplatKernels::fill_footprints> fill_footprints;
FunctionOf<&SplatKernels::splat_slabs> splat_slabs;
FunctionOf<&SplatKernels::splat_wide_slabs> splat_wide_slabs;

}  // namespace volsplat::VOLSPLAT_PATH
#endif
