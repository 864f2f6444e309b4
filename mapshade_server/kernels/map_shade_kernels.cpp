#include "paths/map_shade_kernels.h"

#include "kernels/cpu_path.h"

namespace volsplat {

VOLSPLAT_ON_EACH_PATH(extern const MapShadeKernels kMapShadeKernels)

const MapShadeKernels& map_shade_kernels() {
    static constexpr const MapShadeKernels* kTables[] = {VOLSPLAT_OF_EACH_PATH(kMapShadeKernels)};
    return *kTables[cpu_path_number()];
}

}  // namespace volsplat
