// The owners of regions, and what is handed to them, as Python sees them.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_owners(nanobind::module_& m);

}  // namespace volsplat
