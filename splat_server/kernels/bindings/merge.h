// The merge as Python sees it.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <vector>

#include "splat_server/kernels/merge.h"

namespace volsplat {

using Bytes = nanobind::ndarray<nanobind::ro, nanobind::c_contig, nanobind::device::cpu>;

// A batch's memory, pinned for as long as the object lives.
struct BatchMemory {
    Bytes runs, packets;
};

// Spans in merge order; their batches must stay alive until they are splatted.
struct SpanList {
    std::vector<MergeSpan> spans;
    std::vector<SpanView> views;
    std::uint64_t packets;
};

void bind_merge(nanobind::module_& m);

}  // namespace volsplat
