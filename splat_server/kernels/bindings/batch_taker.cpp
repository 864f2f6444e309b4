#include "splat_server/kernels/regions/batch_taker.h"

#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

#include "batch_taker.h"
#include "kernels/interpreter_lock.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

std::vector<TakenSpan> unlocked_spans(BatchTaker& taker) {
    const Unlocked unlocked;
    return taker.spans();
}

// By how many seconds they lie back: Python's clock may count from another moment.
std::vector<std::tuple<int, double, double>> spans(BatchTaker& taker) {
    const std::vector<TakenSpan> taken = unlocked_spans(taker);
    const Clock::time_point now = Clock::now();
    const auto ago = [&](Clock::time_point then) { return std::chrono::duration<double>(now - then).count(); };
    std::vector<std::tuple<int, double, double>> all;
    for (const TakenSpan& span : taken) all.push_back({span.walker, ago(span.began), ago(span.ended)});
    return all;
}

}  // namespace

void bind_batch_taker(nb::module_& m) {
    typedef nb::call_guard<Unlocked> WithoutLock;
    nb::class_<BatchTaker>(m, "BatchTaker")
        .def(
            "__init__",
            [](BatchTaker* self, int descriptor, int walkers, int blocks, std::size_t block_bytes,
               std::shared_ptr<Bell> news) {
                const ChannelShape shape{walkers, blocks, block_bytes};
                new (self) BatchTaker(std::make_shared<ChannelMemory>(descriptor, shape), std::move(news));
            },
            "descriptor"_a, "walkers"_a, "blocks"_a, "block_bytes"_a, "news"_a)
        .def_static(
            "memory_bytes",
            [](int walkers, int blocks, std::size_t block_bytes) {
                return ChannelMemory::bytes({walkers, blocks, block_bytes});
            },
            "walkers"_a, "blocks"_a, "block_bytes"_a)
        .def("begin", &BatchTaker::begin, "frame"_a, "into"_a.none(), "first_source"_a, "walkers"_a, "traced"_a,
             WithoutLock())
        .def("drain", &BatchTaker::drain, WithoutLock())
        .def("close", &BatchTaker::close, WithoutLock())
        .def("take_news", &BatchTaker::take_news)
        .def_prop_ro("fault", &BatchTaker::fault, WithoutLock())
        .def_prop_ro("newest_frame", &BatchTaker::newest_frame)
        .def_prop_ro("bytes", &BatchTaker::bytes)
        .def_prop_ro("spans", &spans);
}

}  // namespace volsplat
