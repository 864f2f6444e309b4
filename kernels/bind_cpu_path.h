// The choice of the CPU path as every module of kernels offers it to Python.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_cpu_path(nanobind::module_& m);

}  // namespace volsplat
