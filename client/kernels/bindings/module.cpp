// What volsplat.client._kernels has is all of the shared room.
#include <nanobind/nanobind.h>

#include "kernels/bind_image_tiles.h"
#include "kernels/bind_module.h"
#include "kernels/tables/bind_patch_table.h"

NB_MODULE(_kernels, m) {
    m.doc() = "Kernels of the client.";
    volsplat::bind_module(m);
    volsplat::bind_image_tiles(m);
    volsplat::bind_patch_table(m);
}
