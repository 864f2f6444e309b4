#include "paths/splat_kernels.h"

#include "kernels/cpu_path.h"

namespace volsplat {

VOLSPLAT_ON_EACH_PATH(extern const SplatKernels kSplatKernels)

const SplatKernels& splat_kernels() {
    static constexpr const SplatKernels* kTables[] = {VOLSPLAT_OF_EACH_PATH(kSplatKernels)};
    return *kTables[cpu_path_number()];
}

}  // namespace volsplat
