// Binds the channels that walkers send batches through.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_batch_channel(nanobind::module_& m);

}  // namespace volsplat
