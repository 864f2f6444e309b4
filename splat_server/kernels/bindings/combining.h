// Footprint table, cells and edges as Python sees them.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_combining(nanobind::module_& m);

}  // namespace volsplat
