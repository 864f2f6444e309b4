// The decoder of batches as Python sees it.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_batch_decoder(nanobind::module_& m);

}  // namespace volsplat
