// SlabWalk as Python sees it.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_slab_walk(nanobind::module_& m);

}  // namespace volsplat
