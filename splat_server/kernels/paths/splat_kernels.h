// The hot loops that exist once for each instruction set.
#pragma once

#include "kernels/path_table.h"
#include "splat_server/kernels/footprint_box.h"
#include "splat_server/kernels/slab_samples.h"
#include "splat_server/kernels/slab_sums.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat {

// The kernels of one instruction set.
struct SplatKernels {
    // Splats spans of merged runs into rows of the image.
    Kernel<SplatOutcome(const SplatJob& job)> splat;

    // Writes a band of [offsets x][height][pitch] weights; `weights` are where it begins in the first box.
    Kernel<void(const FootprintBox& box, const FootprintBand& band, float* weights)> fill_footprints;

    // Finds the voxels of runs, behind those found before, for which there is room; returns how many are hidden.
    Kernel<std::uint64_t(const SlabTableView& table, const SlabSums& sums, const ImageView& image, const SlabRuns& runs,
                         SlabVoxels& found)>
        find_slab_voxels;

    // Add voxels of a group to the planes that they reach, in sums of 32 and of 64 bits.
    Kernel<void(const SlabTableView& table, const SlabSums& sums, const SlabVoxel* voxels, std::uint64_t count)>
        splat_slabs, splat_wide_slabs;

    // Put densities in the place of the sums of a complete block, at so many neighbouring pixels.
    Kernel<void(const SlabSums& sums, void* block, int pixels)> find_slab_densities, find_wide_slab_densities;

    // Marks the slabs that show anything, with 1 and 0, at neighbouring pixels: kBlockPlanes of them, of which the last
    // ends on the plane before the block's last.
    Kernel<void(const SlabShadingView& view, const SlabDensities& densities, int pixels,
                std::uint8_t (*shown)[kBlockPlanes])>
        find_shown_slabs;

    // Classifies and lights them.
    Kernel<void(const SlabShadingView& view, SlabSamples& samples)> find_slab_colours;
};

// Those of the CPU path in use.
const SplatKernels& splat_kernels();

}  // namespace volsplat

#if defined(VOLSPLAT_PATH)
namespace volsplat::VOLSPLAT_PATH {

FunctionOf<&SplatKernels::splat> splat;
FunctionOf<&SplatKernels::fill_footprints> fill_footprints;
FunctionOf<&SplatKernels::find_slab_voxels> find_slab_voxels;
FunctionOf<&SplatKernels::splat_slabs> splat_slabs;
FunctionOf<&SplatKernels::splat_wide_slabs> splat_wide_slabs;
FunctionOf<&SplatKernels::find_slab_densities> find_slab_densities;
FunctionOf<&SplatKernels::find_wide_slab_densities> find_wide_slab_densities;
FunctionOf<&SplatKernels::find_shown_slabs> find_shown_slabs;
FunctionOf<&SplatKernels::find_slab_colours> find_slab_colours;

}  // namespace volsplat::VOLSPLAT_PATH
#endif
