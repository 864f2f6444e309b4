// Lists the kernels of one instruction set.
#include "path_functions.h"

namespace volsplat::VOLSPLAT_PATH {

extern const PathKernels kKernels = {compact, transpose, shade, gradient, survey, pack};

}  // namespace volsplat::VOLSPLAT_PATH
