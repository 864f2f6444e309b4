#include "walker.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <memory>
#include <stdexcept>
#include <vector>

#include "kernels/lent_bytes.h"
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

// ([(runs, packets, run count, packet count) for each region], (sheet, row) reached, last, voxels visited)
nb::tuple next_batch(BatchWalker& walker, std::int64_t max_packets, std::int64_t max_voxels) {
    const BatchLimits limits = limits_of(max_packets, max_voxels);
    const std::shared_ptr<Batch> batch = free_batch();
    {
        nb::gil_scoped_release unlocked;
        walker.next_batch(limits, *batch);
    }
    nb::list parts;
    for (ShadedPart& part : batch->parts) {
        parts.append(nb::make_tuple(view_of(batch, part.runs.data(), part.runs.size() * sizeof(RowRun)),
                                    view_of(batch, part.packets.data(), part.packet_count * sizeof(std::uint64_t)),
                                    part.runs.size(), part.packet_count));
    }
    return nb::make_tuple(parts, nb::make_tuple(batch->reached_sheet, batch->reached_row), batch->last,
                          batch->voxels_visited);
}

// Without the GIL: many walkers of a server do so at once.
void put_side_by_side(const std::vector<LentBytes>& memories, const LentRoom& target) {
    std::size_t bytes = 0;
    for (const LentBytes& memory : memories) bytes += memory.nbytes();
    if (bytes > target.nbytes()) throw std::invalid_argument("the memory does not hold what is to lie there");
    const nb::gil_scoped_release unlocked;
    std::uint8_t* place = target.data();
    for (const LentBytes& memory : memories) {
        if (memory.nbytes()) std::memcpy(place, memory.data(), memory.nbytes());
        place += memory.nbytes();
    }
}

}  // namespace

void bind_walker(nb::module_& m) {
    nb::class_<BatchWalker>(m, "Walker")
        .def("next_batch", &next_batch, "max_packets"_a, "max_voxels"_a)
        .def_prop_ro("source", [](BatchWalker& walker) {
            return nb::capsule(static_cast<BatchSource*>(&walker), kBatchSourceCapsule);
        });
    m.def("put_side_by_side", &put_side_by_side, "memories"_a, "target"_a);
}

}  // namespace volsplat
