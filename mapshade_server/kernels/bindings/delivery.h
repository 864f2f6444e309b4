// Deliveries as Python sees them.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_delivery(nanobind::module_& m);

}  // namespace volsplat
