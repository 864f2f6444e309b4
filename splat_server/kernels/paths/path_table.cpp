// Lists the kernels of one instruction set.
#include "splat_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

extern constinit const SplatKernels kSplatKernels = {
    .splat = splat,
    .fill_footprints = fill_footprints,
    .find_slab_voxels = find_slab_voxels,
    .splat_slabs = splat_slabs,
    .splat_wide_slabs = splat_wide_slabs,
    .find_slab_densities = find_slab_densities,
    .find_wide_slab_densities = find_wide_slab_densities,
    .find_shown_slabs = find_shown_slabs,
    .find_slab_colours = find_slab_colours,
};

}  // namespace volsplat::VOLSPLAT_PATH
