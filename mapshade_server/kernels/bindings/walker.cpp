#include "walker.h"

#include <nanobind/ndarray.h>

#include <memory>

#include "kernels/interpreter_lock.h"
#include "walk_arguments.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

// A writable view of a batch's bytes that keeps the batch from being reused.
nb::object view_of(const std::shared_ptr<Batch>& batch, void* data, std::size_t bytes) {
    nb::capsule owner(new std::shared_ptr<Batch>(batch),
                      [](void* p) noexcept { delete static_cast<std::shared_ptr<Batch>*>(p); });
    nb::object array = nb::cast(nb::ndarray<nb::array_api, std::uint8_t>(data, {bytes}, owner));
    return nb::steal(PyMemoryView_FromObject(array.ptr()));
}

PythonBatch next_batch(BatchWalker& walker, std::int64_t max_packets, std::int64_t max_voxels) {
    const BatchLimits limits = limits_of(max_packets, max_voxels);
    const std::shared_ptr<Batch> batch = free_batch();
    walker.next_batch(limits, *batch);
    return {batch};
}

// (runs, packets, run count, packet count) for each region
nb::list parts(const PythonBatch& python) {
    nb::list parts;
    for (ShadedPart& part : python.batch->parts) {
        parts.append(nb::make_tuple(view_of(python.batch, part.runs.data(), part.runs.size() * sizeof(RowRun)),
                                    view_of(python.batch, part.packets.data(), part.packet_count * kPacketBytes),
                                    part.runs.size(), part.packet_count));
    }
    return parts;
}

}  // namespace

void bind_walker(nb::module_& m) {
    typedef nb::call_guard<Unlocked> WithoutLock;
    nb::class_<PythonBatch>(m, "Batch")
        .def_prop_ro("parts", &parts)
        .def_prop_ro("reached",
                     [](const PythonBatch& python) {
                         return nb::make_tuple(python.batch->reached_sheet, python.batch->reached_row);
                     })
        .def_prop_ro("last", [](const PythonBatch& python) { return python.batch->last; })
        .def_prop_ro("voxels_visited", [](const PythonBatch& python) { return python.batch->voxels_visited; })
        .def_prop_ro("packet_count", [](const PythonBatch& python) { return python.batch->packet_count(); });
    nb::class_<BatchWalker>(m, "Walker")
        .def("next_batch", &next_batch, "max_packets"_a, "max_voxels"_a, WithoutLock())
        .def_prop_ro("source", [](BatchWalker& walker) {
            return nb::capsule(static_cast<BatchSource*>(&walker), kBatchSourceCapsule);
        });
}

}  // namespace volsplat
