// Lists the kernels of one instruction set.
#include "path_functions.h"

namespace volsplat::VOLSPLAT_PATH {

extern const PathKernels kKernels = {
    classify_row,       classify_columns, leave_out_hidden, opacity_by_packet,
    opacity_by_indices, direction_bytes,  screen_bytes,     grid_bytes,
    shade,              power,            light,            opacity_codes,
    gradient,           survey,           pack};

}  // namespace volsplat::VOLSPLAT_PATH
