#include "combining.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <utility>

#include "merge.h"
#include "splat_server/kernels/edge_layer.h"
#include "splat_server/kernels/footprint_table.h"
#include "splat_server/kernels/image_memory.h"
#include "splat_server/kernels/image_publishing.h"
#include "splat_server/kernels/splat_queue.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

// The image with the blocks that it is published in.
struct PythonImage {
    PythonImage(int width, int height) : memory(width, height), blocks(static_cast<std::size_t>(width) * height * 4) {}
    ImageMemory memory;
    ImageBlocks blocks;
};

using Axis = std::tuple<std::int64_t, std::int64_t, std::int64_t, std::int64_t, std::int64_t, bool>;
using Map = std::array<std::int64_t, 4>;  // origin, half steps along sheet, row, sample

CellView cell_view(const Map& x, const Map& y, const std::array<Axis, 3>& axes) {
    CellView view{{x[0], y[0]}, {{x[1], x[2], x[3]}, {y[1], y[2], y[3]}}, {}};
    for (int n = 0; n < 3; ++n) {
        const auto [low, high, stride, first, count, ascending] = axes[n];
        if (stride < 1 || count < 1) throw std::invalid_argument("an axis of cells needs a stride and a count");
        view.axes[n] = {{low, high, stride, first, count}, ascending};
    }
    return view;
}

// As protocol.packet_layout.opacity_of_code.
const float* opacities() {
    static const std::array<float, kOpacityMask + 1> table = [] {
        std::array<float, kOpacityMask + 1> values;
        for (int code = 0; code <= kOpacityMask; ++code) {
            const int exponent = code >> 8, mantissa = code & 255;
            const double units = exponent == 0 ? mantissa : std::ldexp(256 + mantissa, exponent - 1);
            values[code] = static_cast<float>(units / kOpacityUnit);
        }
        return values;
    }();
    return table.data();
}

// A view of memory that `owner` keeps.
nb::object writable_view(nb::object array) { return nb::steal(PyMemoryView_FromObject(array.ptr())); }

// Bytes of an image filled by `fill`, which runs without the GIL.
template <class Fill>
nb::object filled_block(PythonImage& image, Fill fill) {
    const std::shared_ptr<float[]> block = image.blocks.free_block();
    {
        nb::gil_scoped_release unlocked;
        fill(block.get());
    }
    nb::capsule owner(new std::shared_ptr<float[]>(block),
                      [](void* p) noexcept { delete static_cast<std::shared_ptr<float[]>*>(p); });
    return writable_view(
        nb::cast(nb::ndarray<nb::array_api, std::uint8_t>(block.get(), {image.blocks.bytes()}, owner)));
}

// The queue with all that its jobs point to, which is let go of by threads that hold the GIL.
class PythonQueue {
public:
    PythonQueue(nb::object image, int threads)
        : image_(std::move(image)), queue_(nb::cast<PythonImage&>(image_).memory, threads) {}

    void begin(bool turned, int first_line, int end_line) {
        without_gil([&] { queue_.begin(turned, {first_line, end_line}); });
    }
    void finish() {
        without_gil([&] { queue_.finish(); });
    }
    void cancel() {
        without_gil([&] { queue_.cancel(); });
    }
    void close() {
        without_gil([&] { queue_.close(); });
    }

    void splat(nb::object spans, nb::object reach, bool front_to_back, bool small, nb::object batches) {
        const SpanList& list = nb::cast<const SpanList&>(spans);
        SplatJob job{};
        aim(job, reach);
        job.opacities = opacities();
        job.spans = list.views.data();
        job.span_count = list.views.size();
        job.front_to_back = front_to_back;
        owners_.emplace_back(kUnknown, nb::make_tuple(std::move(spans), std::move(reach), std::move(batches)));
        try {
            without_gil([&] { owners_.back().first = queue_.add(job, small); });
        } catch (...) {
            owners_.pop_back();
            throw;
        }
    }

    nb::object hand_out() {
        PythonImage& image = nb::cast<PythonImage&>(image_);
        const nb::object block = filled_block(image, [&](float* target) { queue_.hand_out(target); });
        release();
        return block;
    }

    bool busy() { return queue_.busy(); }
    double busy_seconds() { return queue_.busy_seconds(); }

private:
    template <class Call>
    void without_gil(Call call) {
        {
            nb::gil_scoped_release unlocked;
            call();
        }
        release();
    }

    static void aim(SplatJob& job, const nb::object& reach) {
        job.reach = Reach::pixel;
        if (nb::isinstance<FootprintTable>(reach)) {
            job.reach = Reach::footprint;
            job.footprint = nb::cast<const FootprintTable&>(reach).view();
        } else if (nb::isinstance<CellView>(reach)) {
            job.reach = Reach::cell;
            job.cell = nb::cast<const CellView&>(reach);
        }
    }

    void release() {
        const std::uint64_t finished = queue_.finished();
        while (!owners_.empty() && owners_.front().first <= finished) owners_.pop_front();
    }

    static constexpr std::uint64_t kUnknown = ~std::uint64_t{0};

    std::deque<std::pair<std::uint64_t, nb::object>> owners_;  // by the number of the job
    const nb::object image_;
    SplatQueue queue_;  // ended before what its jobs point to
};

nb::object snapshot(PythonImage& image) {
    return filled_block(image, [&](float* target) { publish(image.memory, target); });
}

nb::object published(PythonImage& image, const EdgeLayer& front, const EdgeLayer& back) {
    return filled_block(image, [&](float* target) { publish_between(image.memory, front, back, target); });
}

nb::object closed_tiles(nb::handle_t<PythonImage> self) {
    ImageMemory& memory = nb::cast<PythonImage&>(self).memory;
    const std::size_t shape[] = {static_cast<std::size_t>(memory.tile_rows()),
                                 static_cast<std::size_t>(memory.tile_words())};
    return writable_view(nb::cast(nb::ndarray<nb::array_api, std::uint64_t>(memory.closed_tiles(), 2, shape, self)));
}

}  // namespace

void bind_combining(nb::module_& m) {
    nb::class_<KernelProjection>(m, "KernelProjection")
        .def(nb::init<const std::string&, double, double>(), "kernel"_a, "parameter"_a, "radius"_a)
        .def("at_square", &KernelProjection::at_square, "rho_square"_a);
    nb::class_<Ellipse>(m, "Ellipse")
        .def(
            "__init__",
            [](Ellipse* self, double amplitude, double qxx, double qxy, double qyy, double half_width,
               double half_height) { new (self) Ellipse{amplitude, qxx, qxy, qyy, half_width, half_height}; },
            "amplitude"_a, "qxx"_a, "qxy"_a, "qyy"_a, "half_width"_a, "half_height"_a);
    nb::class_<FootprintTable>(m, "FootprintTable")
        .def(nb::init<const KernelProjection&, const Ellipse&, int>(), "projection"_a, "ellipse"_a, "offset_bits"_a,
             nb::call_guard<nb::gil_scoped_release>())
        .def_static("bytes_needed", &FootprintTable::bytes_needed, "ellipse"_a, "offset_bits"_a)
        .def(
            "weights_at", [](const FootprintTable& self, int fx, int fy) { return self.weights_at(fx, fy); }, "fx"_a,
            "fy"_a)
        .def_prop_ro("offset_bits", &FootprintTable::offset_bits)
        .def_prop_ro("width", &FootprintTable::width)
        .def_prop_ro("height", &FootprintTable::height)
        .def_prop_ro("bytes", &FootprintTable::bytes);
    nb::class_<CellView>(m, "CellMap")
        .def(
            "__init__",
            [](CellView* self, const Map& x, const Map& y, const std::array<Axis, 3>& axes) {
                new (self) CellView(cell_view(x, y, axes));
            },
            "x"_a, "y"_a, "axes"_a);
    nb::class_<PythonQueue>(m, "SplatQueue")
        .def(nb::init<nb::object, int>(), "image"_a, "threads"_a)
        .def("begin", &PythonQueue::begin, "turned"_a, "first_line"_a, "end_line"_a)
        .def("splat", &PythonQueue::splat, "spans"_a, "reach"_a.none(), "front_to_back"_a, "small"_a,
             "batches"_a.none())
        .def("finish", &PythonQueue::finish)
        .def("hand_out", &PythonQueue::hand_out)
        .def("cancel", &PythonQueue::cancel)
        .def("close", &PythonQueue::close)
        .def_prop_ro("busy", &PythonQueue::busy)
        .def_prop_ro("busy_seconds", &PythonQueue::busy_seconds);
    nb::class_<PythonImage>(m, "ImageMemory")
        .def(nb::init<int, int>(), "width"_a, "height"_a)
        .def("snapshot", &snapshot)
        .def_prop_ro("closed_tiles", &closed_tiles)
        .def_prop_ro("hidden_packets", [](const PythonImage& self) { return self.memory.hidden_packets(); });
    nb::class_<EdgeLayer>(m, "EdgeLayer")
        .def(nb::init<int, int>(), "width"_a, "height"_a)
        .def("draw", &EdgeLayer::draw, "x0"_a, "y0"_a, "x1"_a, "y1"_a, "line_width"_a);
    m.def("published", &published, "image"_a, "front"_a, "back"_a);
}

}  // namespace volsplat
