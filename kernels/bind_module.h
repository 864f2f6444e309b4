// What every module of kernels offers to Python: the choice of the CPU path, and the numbers that it was built with.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_module(nanobind::module_& m);

}  // namespace volsplat
