// BatchEncoder as Python sees it.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_batch_encoder(nanobind::module_& m);

}  // namespace volsplat
