#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_patch_table(nanobind::module_& m);

}  // namespace volsplat
