#include "batch_channel.h"

#include <nanobind/stl/shared_ptr.h>

#include <memory>

#include "kernels/interpreter_lock.h"
#include "mapshade_server/kernels/batches/batch_channel.h"
#include "walker.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

void bind_batch_channel(nb::module_& m) {
    typedef nb::call_guard<Unlocked> WithoutLock;
    nb::class_<ChannelMemory>(m, "ChannelMemory")
        .def(
            "__init__",
            [](ChannelMemory* self, int descriptor, int walkers, int blocks, std::size_t block_bytes) {
                new (self) ChannelMemory(descriptor, {walkers, blocks, block_bytes});
            },
            "descriptor"_a, "walkers"_a, "blocks"_a, "block_bytes"_a)
        .def_static(
            "bytes",
            [](int walkers, int blocks, std::size_t block_bytes) {
                return ChannelMemory::bytes({walkers, blocks, block_bytes});
            },
            "walkers"_a, "blocks"_a, "block_bytes"_a);
    nb::class_<BatchChannel>(m, "BatchChannel")
        .def(nb::init<std::shared_ptr<ChannelMemory>, int>(), "memory"_a, "walker"_a)
        .def(
            "begin",
            [](BatchChannel& channel, std::int64_t frame, const PythonBatch& python, std::size_t first,
               std::size_t end) { channel.begin(frame, python.batch, first, end); },
            "frame"_a, "batch"_a, "first"_a, "end"_a)
        .def(
            "send",
            [](BatchChannel& channel, double seconds) { return channel.send(seconds) == BatchChannel::Sent::all; },
            "seconds"_a, WithoutLock())
        .def("close", &BatchChannel::close);
}

}  // namespace volsplat
