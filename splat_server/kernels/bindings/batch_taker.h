// Binds what takes batches out of shared memory.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_batch_taker(nanobind::module_& m);

}  // namespace volsplat
