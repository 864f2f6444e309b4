#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_image_tiles(nanobind::module_& m);

}  // namespace volsplat
