#include "merge.h"

#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <string>

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

std::size_t bytes_of(const Bytes& array) { return array.size() * array.itemsize(); }

BatchMemory batch_memory(Bytes runs, Bytes packets) {
    if (bytes_of(runs) % sizeof(RowRun))
        throw std::invalid_argument("row runs take 24 bytes each, but there are " + std::to_string(bytes_of(runs)));
    if (bytes_of(packets) % 8)
        throw std::invalid_argument("packets take 8 bytes each, but there are " + std::to_string(bytes_of(packets)));
    return {std::move(runs), std::move(packets)};
}

void push(SortedBuffers& merge, int worker, std::uint64_t batch, const BatchMemory& memory, std::uint64_t reached_sheet,
          std::uint64_t reached_row, bool last) {
    merge.push(worker, batch, static_cast<const unsigned char*>(memory.runs.data()),
               bytes_of(memory.runs) / sizeof(RowRun), static_cast<const unsigned char*>(memory.packets.data()),
               bytes_of(memory.packets) / kPacketBytes, reached_sheet, reached_row, last);
}

nb::tuple advance(SortedBuffers& merge, std::uint64_t max_packets) {
    MergeProgress progress;
    {
        nb::gil_scoped_release unlocked;
        progress = merge.advance(max_packets);
    }
    SpanList spans{std::move(progress.spans), {}, progress.packets};
    for (const MergeSpan& span : spans.spans) spans.views.push_back(span.view);
    return nb::make_tuple(std::move(spans), progress.released, progress.waits_for, progress.complete);
}

std::vector<std::tuple<std::uint64_t, std::uint64_t, std::uint64_t, std::uint64_t, std::uint64_t>> entries(
    const SpanList& list) {
    std::vector<std::tuple<std::uint64_t, std::uint64_t, std::uint64_t, std::uint64_t, std::uint64_t>> found;
    for (const MergeSpan& span : list.spans)
        found.emplace_back(span.batch, span.first_run, span.run_count, span.first_packet, span.packet_count);
    return found;
}

}  // namespace

void bind_merge(nb::module_& m) {
    nb::class_<BatchMemory>(m, "BatchMemory")
        .def(
            "__init__",
            [](BatchMemory* self, Bytes runs, Bytes packets) {
                new (self) BatchMemory(batch_memory(std::move(runs), std::move(packets)));
            },
            "runs"_a, "packets"_a)
        .def_prop_ro("bytes", [](const BatchMemory& self) { return bytes_of(self.runs) + bytes_of(self.packets); })
        .def_prop_ro("packet_count", [](const BatchMemory& self) { return bytes_of(self.packets) / kPacketBytes; })
        .def_prop_ro("run_count", [](const BatchMemory& self) { return bytes_of(self.runs) / sizeof(RowRun); });
    nb::class_<SpanList>(m, "SpanList")
        .def_prop_ro("packets", [](const SpanList& self) { return self.packets; })
        .def("entries", &entries)
        .def("__len__", [](const SpanList& self) { return self.spans.size(); });
    nb::class_<SortedBuffers>(m, "SortedBuffers")
        .def(nb::init<int, std::uint64_t, std::uint64_t, std::uint64_t>(), "workers"_a, "sheets"_a, "rows"_a,
             "samples"_a)
        .def("push", &push, "worker"_a, "batch"_a, "memory"_a, "reached_sheet"_a, "reached_row"_a, "last"_a)
        .def("finish", &SortedBuffers::finish, "worker"_a)
        .def("advance", &advance, "max_packets"_a)
        .def("validate", &SortedBuffers::validate)
        .def_prop_ro("waits_for", &SortedBuffers::waits_for)
        .def_prop_ro("complete", &SortedBuffers::complete);
}

}  // namespace volsplat
