// The fields that can index the shading tables: volsplat.protocol.description.shading_tables.Field, in its order.
#pragma once

namespace volsplat {

enum class Field {
    density,
    strength,
    gradient_i,
    gradient_j,
    gradient_k,
    screen_x,
    screen_y,
    screen_z,
    grid_i,
    grid_j,
    grid_k
};

}  // namespace volsplat
