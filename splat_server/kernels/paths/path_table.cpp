// Lists the kernels of one instruction set.
#include "splat_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

extern constinit const SplatKernels kSplatKernels = {
    .splat = splat,
    .fill_footprints = fill_footprints,
    .splat_slabs = splat_slabs,
    .splat_wide_slabs = splat_wide_slabs,
};

}  // namespace volsplat::VOLSPLAT_PATH
