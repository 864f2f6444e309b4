// What a frame of slabs is drawn by, as Python sees it.
#pragma once

#include <nanobind/nanobind.h>

#include "splat_server/kernels/regions/slab_planes.h"

namespace volsplat {

// With what it points to.
struct PythonSlabs {
    nanobind::object table;
    nanobind::object lamp, sky;  // or None
    SlabShading shading;
    SlabFrame frame;
};

void bind_slabs(nanobind::module_& m);

}  // namespace volsplat
