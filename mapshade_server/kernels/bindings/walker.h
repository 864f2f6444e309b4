// Walkers and their batches as Python sees them.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>

#include "mapshade_server/kernels/batches/batch.h"

namespace volsplat {

struct PythonBatch {
    std::shared_ptr<Batch> batch;
};

void bind_walker(nanobind::module_& m);

}  // namespace volsplat
