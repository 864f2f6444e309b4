#include "delivery.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "kernels/interpreter_lock.h"
#include "mapshade_server/kernels/delivery/channel_outlet.h"
#include "mapshade_server/kernels/delivery/crew.h"
#include "mapshade_server/kernels/delivery/delivery.h"
#include "walker.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

using Clock = std::chrono::steady_clock;
using TileMap = nb::ndarray<std::uint64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// One that Python sends through: an object with most_packets() and send(batch).
class PythonOutlet : public Outlet {
public:
    explicit PythonOutlet(nb::object outlet) : outlet_(std::move(outlet)) {}
    ~PythonOutlet() override {
        const Locked locked;
        outlet_.reset();
    }

    std::size_t most_packets() override {
        const Locked locked;
        const double most = nb::cast<double>(outlet_.attr("most_packets")());
        return most < 1e18 ? static_cast<std::size_t>(std::max(most, 1.0)) : Outlet::most_packets();
    }

    bool send(const std::shared_ptr<Batch>& batch) override {
        const Locked locked;
        return nb::cast<bool>(outlet_.attr("send")(PythonBatch{batch}));
    }

private:
    nb::object outlet_;
};

// Keeps the memory of the map as well.
class PythonChannelOutlet {
public:
    PythonChannelOutlet(std::shared_ptr<BatchChannel> channel, std::int64_t frame, std::size_t first, std::size_t end,
                        std::optional<TileMap> tiles, std::shared_ptr<StillWanted> wanted)
        : tiles_(std::move(tiles)),
          outlet(std::make_shared<ChannelOutlet>(std::move(channel), frame, first, end,
                                                 tiles_ ? tiles_->data() : nullptr, tiles_ ? tiles_->size() : 0,
                                                 std::move(wanted))) {}

private:
    const std::optional<TileMap> tiles_;

public:
    const std::shared_ptr<ChannelOutlet> outlet;
};

// Keeps alive what the delivery borrows.
class PythonDelivery {
public:
    PythonDelivery(std::vector<nb::object> walkers, std::vector<std::vector<nb::object>> outlets,
                   std::shared_ptr<StillWanted> wanted)
        : walkers_(std::move(walkers)),
          outlets_(std::move(outlets)),
          delivery(walkers_of(walkers_), all_outlets(outlets_), std::move(wanted)) {}

private:
    static std::vector<BatchWalker*> walkers_of(const std::vector<nb::object>& walkers) {
        std::vector<BatchWalker*> all;
        for (const nb::object& walker : walkers) all.push_back(nb::cast<BatchWalker*>(walker));
        return all;
    }

    static std::shared_ptr<Outlet> outlet_of(const nb::object& outlet) {
        if (outlet.is_none()) return nullptr;
        if (nb::isinstance<PythonChannelOutlet>(outlet)) return nb::cast<const PythonChannelOutlet&>(outlet).outlet;
        return std::make_shared<PythonOutlet>(outlet);
    }

    static std::vector<Delivery::Outlets> all_outlets(const std::vector<std::vector<nb::object>>& outlets) {
        std::vector<Delivery::Outlets> all(outlets.size());
        for (std::size_t n = 0; n < outlets.size(); ++n)
            for (const nb::object& outlet : outlets[n]) all[n].push_back(outlet_of(outlet));
        return all;
    }

    const std::vector<nb::object> walkers_;
    const std::vector<std::vector<nb::object>> outlets_;

public:
    Delivery delivery;
};

// By `span_clock`.
double seconds(Clock::time_point moment) { return std::chrono::duration<double>(moment.time_since_epoch()).count(); }

std::vector<std::pair<double, double>> walk_spans(const PythonDelivery& python, std::size_t walker) {
    std::vector<std::pair<double, double>> all;
    for (const WalkSpan& span : python.delivery.tally(walker).spans)
        all.push_back({seconds(span.began), seconds(span.ended)});
    return all;
}

std::vector<std::tuple<double, double, double>> send_spans(const PythonChannelOutlet& python) {
    std::vector<std::tuple<double, double, double>> all;
    for (const SendSpan& span : python.outlet->tally().spans)
        all.push_back({seconds(span.began), seconds(span.waited), seconds(span.ended)});
    return all;
}

}  // namespace

void bind_delivery(nb::module_& m) {
    m.def("span_clock", [] { return seconds(Clock::now()); });
    nb::class_<NewestFrame>(m, "NewestFrame")
        .def("__init__", [](NewestFrame* self) { new (self) NewestFrame(0); })
        .def_prop_rw(
            "number", [](const NewestFrame& newest) { return newest.load(); },
            [](NewestFrame& newest, std::int64_t number) { newest = number; });
    nb::class_<StillWanted>(m, "StillWanted")
        .def(nb::init<std::shared_ptr<NewestFrame>, std::int64_t>(), "newest"_a, "frame"_a)
        .def("__call__", &StillWanted::operator())
        .def("end", &StillWanted::end);
    nb::class_<PythonChannelOutlet>(m, "ChannelOutlet")
        .def(nb::init<std::shared_ptr<BatchChannel>, std::int64_t, std::size_t, std::size_t, std::optional<TileMap>,
                      std::shared_ptr<StillWanted>>(),
             "channel"_a, "frame"_a, "first"_a, "end"_a, "tiles"_a.none().noconvert(), "wanted"_a)
        .def_prop_ro("bytes", [](const PythonChannelOutlet& python) { return python.outlet->tally().bytes; })
        .def_prop_ro("seconds", [](const PythonChannelOutlet& python) { return python.outlet->tally().seconds; })
        .def_prop_ro("waiting_seconds",
                     [](const PythonChannelOutlet& python) { return python.outlet->tally().waiting_seconds; })
        .def_prop_ro("spans", &send_spans);
    nb::class_<Crew>(m, "Crew").def(nb::init<>());
    nb::class_<WalkTally>(m, "WalkTally")
        .def_ro("batches", &WalkTally::batches)
        .def_ro("packets", &WalkTally::packets)
        .def_ro("voxels", &WalkTally::voxels)
        .def_ro("seconds", &WalkTally::seconds);
    nb::class_<PythonDelivery>(m, "Delivery")
        .def(nb::init<std::vector<nb::object>, std::vector<std::vector<nb::object>>, std::shared_ptr<StillWanted>>(),
             "walkers"_a, "outlets"_a, "wanted"_a)
        .def(
            "run",
            [](PythonDelivery& python, Crew& crew, const nb::callable& on_failure) {
                const Unlocked unlocked;
                python.delivery.run(crew, [&] {
                    const Locked locked;
                    on_failure();
                });
            },
            "crew"_a, "on_failure"_a)
        .def_prop_ro("failed", [](const PythonDelivery& python) { return python.delivery.failed(); })
        .def("check", [](PythonDelivery& python) { python.delivery.check(); })
        .def(
            "tally",
            [](const PythonDelivery& python, std::size_t walker) -> const WalkTally& {
                return python.delivery.tally(walker);
            },
            "walker"_a, nb::rv_policy::reference_internal)
        .def("spans", &walk_spans, "walker"_a)
        .def(
            "lost", [](const PythonDelivery& python, std::size_t server) { return python.delivery.lost(server); },
            "server"_a);
}

}  // namespace volsplat
