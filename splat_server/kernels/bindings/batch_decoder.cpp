#include "batch_decoder.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "kernels/batch_code.h"
#include "kernels/interpreter_lock.h"
#include "kernels/lent_bytes.h"
#include "splat_server/kernels/batch_decoder.h"

namespace volsplat {

namespace nb = nanobind;
using namespace nb::literals;

namespace {

void decode(const LentBytes& code, const std::vector<std::tuple<std::size_t, std::size_t>>& counts,
            const LentRoom& room) {
    // Memory of no bytes lies anywhere.
    if (room.size() && reinterpret_cast<std::uintptr_t>(room.data()) % alignof(std::uint64_t)) {
        throw std::invalid_argument("the room for a batch must be aligned as its packets are");
    }
    std::vector<DecodedPart> parts;
    unsigned char* next = room.data();
    std::size_t left = room.size();
    const auto take = [&](std::size_t count, std::size_t each) {
        if (count > left / each) throw std::invalid_argument("the room for a batch is too small");
        left -= count * each;
        next += count * each;
        return next - count * each;
    };
    for (const auto& [runs, packets] : counts) {
        auto* const first_run = reinterpret_cast<RowRun*>(take(runs, sizeof(RowRun)));
        parts.push_back({first_run, runs, reinterpret_cast<std::uint64_t*>(take(packets, kPacketBytes)), packets});
    }
    const Unlocked unlocked;
    decode_batch(bytes_of(code), code.nbytes(), parts);
}

}  // namespace

void bind_batch_decoder(nb::module_& m) {
    m.def("largest_code", &largest_code, "runs"_a, "packets"_a);
    m.def("decode_batch", &decode, "code"_a, "counts"_a, "room"_a);
}

}  // namespace volsplat
