// Lists the kernels of one instruction set.
#include "splat_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

extern constinit const SplatKernels kSplatKernels = {
    .splat = splat,
    .find_run_rows = find_run_rows,
    .fill_footprints = fill_footprints,
};

}  // namespace volsplat::VOLSPLAT_PATH
