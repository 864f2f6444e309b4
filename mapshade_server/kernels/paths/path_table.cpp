// Lists the kernels of one instruction set.
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

extern constinit const MapShadeKernels kMapShadeKernels = {
    .classify_row = classify_row,
    .classify_columns = classify_columns,
    .leave_out_hidden = leave_out_hidden,
    .opacity_by_packet = opacity_by_packet,
    .opacity_by_indices = opacity_by_indices,
    .direction_bytes = direction_bytes,
    .screen_bytes = screen_bytes,
    .grid_bytes = grid_bytes,
    .shade = shade,
    .power = power,
    .light = light,
    .opacity_codes = opacity_codes,
    .gradient = gradient,
    .survey = survey,
    .pack = pack,
    .least = least,
    .greatest = greatest,
};

}  // namespace volsplat::VOLSPLAT_PATH
