// Preprocessing and shading tables as Python sees them; signatures are in _kernels.pyi.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_preprocessing(nanobind::module_& m);

}  // namespace volsplat
