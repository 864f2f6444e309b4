// Lists what volsplat.mapshade_server._kernels offers; the work lies in the folder above.
#include <nanobind/nanobind.h>

#include "batch_channel.h"
#include "batch_encoder.h"
#include "delivery.h"
#include "frame_walk.h"
#include "kernels/bind_module.h"
#include "kernels/tables/bind_patch_table.h"
#include "mixtures.h"
#include "preprocessing.h"
#include "signs_of_life.h"
#include "slab_walk.h"
#include "walker.h"

NB_MODULE(_kernels, m) {
    m.doc() = "Kernels of the map/shade server.";
    volsplat::bind_module(m);
    volsplat::bind_patch_table(m);
    volsplat::bind_mixtures(m);
    volsplat::bind_preprocessing(m);
    volsplat::bind_walker(m);
    volsplat::bind_batch_channel(m);
    volsplat::bind_delivery(m);
    volsplat::bind_frame_walk(m);
    volsplat::bind_slab_walk(m);
    volsplat::bind_batch_encoder(m);
    volsplat::bind_signs_of_life(m);
}
