#include "paths/bare_loops.h"

#include "kernels/cpu_path.h"

namespace volsplat {

VOLSPLAT_ON_EACH_PATH(extern const BareLoops kBareLoops)

const BareLoops& bare_loops() {
    static constexpr const BareLoops* kTables[] = {VOLSPLAT_OF_EACH_PATH(kBareLoops)};
    return *kTables[cpu_path_number()];
}

}  // namespace volsplat
