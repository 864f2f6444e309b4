#include "batch_encoder.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cstring>
#include <tuple>
#include <vector>

#include "kernels/interpreter_lock.h"
#include "kernels/lent_bytes.h"
#include "mapshade_server/kernels/batch_encoder.h"

namespace volsplat {

namespace nb = nanobind;
using namespace nb::literals;

namespace {

RawPart part_of(const std::tuple<LentBytes, LentBytes>& bytes) {
    const auto& [runs, packets] = bytes;
    return {bytes_of(runs), runs.nbytes() / sizeof(RowRun), bytes_of(packets), packets.nbytes() / kPacketBytes};
}

SampleLattice lattice_of(const std::array<std::int64_t, kLatticeNumbers>& numbers) {
    SampleLattice lattice;
    std::memcpy(&lattice, numbers.data(), sizeof lattice);
    return lattice;
}

nb::object encode(const nb::object& self, const std::vector<std::tuple<LentBytes, LentBytes>>& parts) {
    auto& encoder = nb::cast<BatchEncoder&>(self);
    std::vector<RawPart> raw;
    for (const auto& part : parts) raw.push_back(part_of(part));
    BatchEncoder::Code code;
    {
        const Unlocked unlocked;
        code = encoder.encode(raw);
    }
    const nb::object array = nb::cast(nb::ndarray<nb::array_api, const std::uint8_t>(code.bytes, {code.count}, self));
    return nb::steal(PyMemoryView_FromObject(array.ptr()));
}

}  // namespace

void bind_batch_encoder(nb::module_& m) {
    nb::class_<BatchEncoder>(m, "BatchEncoder")
        .def(
            "__init__",
            [](BatchEncoder* self, const std::array<std::int64_t, kLatticeNumbers>& lattice) {
                new (self) BatchEncoder(lattice_of(lattice));
            },
            "lattice"_a)
        .def("encode", &encode, "parts"_a);
}

}  // namespace volsplat
