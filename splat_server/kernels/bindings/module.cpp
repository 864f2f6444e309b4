// Lists the functions of volsplat.splat_server._kernels; the work lies in the files beside it.
#include <nanobind/nanobind.h>

#include "batch_decoder.h"
#include "batch_taker.h"
#include "combining.h"
#include "kernels/bind_image_tiles.h"
#include "kernels/bind_module.h"
#include "kernels/tables/bind_patch_table.h"
#include "owners.h"
#include "slabs.h"

NB_MODULE(_kernels, m) {
    m.doc() = "Kernels of the splat_server.";
    volsplat::bind_module(m);
    volsplat::bind_owners(m);
    volsplat::bind_batch_taker(m);
    volsplat::bind_combining(m);
    volsplat::bind_patch_table(m);
    volsplat::bind_slabs(m);
    volsplat::bind_batch_decoder(m);
    volsplat::bind_image_tiles(m);
}
