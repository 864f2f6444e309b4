// SignsOfLife as Python sees it.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_signs_of_life(nanobind::module_& m);

}  // namespace volsplat
