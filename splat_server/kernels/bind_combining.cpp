#include "bind_combining.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <stdexcept>

#include "bind_merge.h"
#include "cpu_path.h"
#include "edge_layer.h"
#include "footprint_table.h"
#include "image_memory.h"
#include "splat.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {
namespace {

using Axis = std::tuple<std::int64_t, std::int64_t, std::int64_t, std::int64_t, std::int64_t, bool>;
using Map = std::array<std::int64_t, 4>;  // origin, half steps along sheet, row, sample

CellView cell_view(const Map& x, const Map& y, const std::array<Axis, 3>& axes) {
    CellView view{{x[0], y[0]}, {{x[1], x[2], x[3]}, {y[1], y[2], y[3]}}, {}};
    for (int n = 0; n < 3; ++n) {
        const auto [low, high, stride, first, count, ascending] = axes[n];
        if (stride < 1 || count < 1) throw std::invalid_argument("an axis of cells needs a stride and a count");
        view.axes[n] = {low, high, stride, first, count, ascending};
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
            values[code] = static_cast<float>(units / (511.0 * 16384.0));
        }
        return values;
    }();
    return table.data();
}

void splat_rows(ImageMemory& image, const SpanList& spans, bool front_to_back, int row_begin, int row_end,
                SplatJob job) {
    job.pixels = image.pixels();
    job.pitch = image.pitch();
    job.width = image.width();
    job.row_begin = std::max(row_begin, 0);
    job.row_end = std::min(row_end, image.height());
    job.opacities = opacities();
    job.spans = spans.views.data();
    job.span_count = spans.views.size();
    job.front_to_back = front_to_back;
    nb::gil_scoped_release unlocked;
    splat(job);
}

void splat_footprints(ImageMemory& image, const SpanList& spans, const FootprintTable& table, bool front_to_back,
                      int row_begin, int row_end) {
    SplatJob job{};
    job.reach = Reach::footprint;
    job.footprint = table.view();
    splat_rows(image, spans, front_to_back, row_begin, row_end, job);
}

void splat_cells(ImageMemory& image, const SpanList& spans, const CellView& cells, bool front_to_back, int row_begin,
                 int row_end) {
    SplatJob job{};
    job.reach = Reach::cell;
    job.cell = cells;
    splat_rows(image, spans, front_to_back, row_begin, row_end, job);
}

void splat_pixels(ImageMemory& image, const SpanList& spans, bool front_to_back, int row_begin, int row_end) {
    SplatJob job{};
    job.reach = Reach::pixel;
    splat_rows(image, spans, front_to_back, row_begin, row_end, job);
}

// A bytes object filled by `fill`, which runs without the GIL.
template <class Fill>
nb::bytes filled_bytes(const ImageMemory& image, Fill fill) {
    const auto size = static_cast<std::size_t>(image.width()) * image.height() * 4 * sizeof(float);
    nb::object result = nb::steal(PyBytes_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(size)));
    if (!result.is_valid()) throw nb::python_error();
    auto* target = reinterpret_cast<float*>(PyBytes_AsString(result.ptr()));
    nb::gil_scoped_release unlocked;
    fill(target);
    return nb::borrow<nb::bytes>(result);
}

nb::bytes snapshot(const ImageMemory& image) {
    return filled_bytes(image, [&](float* target) { image.copy_to(target); });
}

nb::bytes published(const ImageMemory& image, const EdgeLayer& front, const EdgeLayer& back) {
    return filled_bytes(image, [&](float* target) { publish_between(image, front, back, target); });
}

}  // namespace

void bind_combining(nb::module_& m) {
    m.def("cpu_paths", &cpu_paths);
    m.def("set_cpu_path", &set_cpu_path, "name"_a);
    m.def("cpu_path", &cpu_path);

    nb::class_<KernelProjection>(m, "KernelProjection")
        .def(nb::init<const std::string&, double, double>(), "kernel"_a, "parameter"_a, "radius"_a)
        .def("at_square", &KernelProjection::at_square, "rho_square"_a);
    nb::class_<Ellipse>(m, "Ellipse")
        .def("__init__", [](Ellipse* self, double amplitude, double qxx, double qxy, double qyy, double half_width,
                            double half_height) {
            new (self) Ellipse{amplitude, qxx, qxy, qyy, half_width, half_height};
        }, "amplitude"_a, "qxx"_a, "qxy"_a, "qyy"_a, "half_width"_a, "half_height"_a);
    nb::class_<FootprintTable>(m, "FootprintTable")
        .def(nb::init<const KernelProjection&, const Ellipse&, int>(), "projection"_a, "ellipse"_a, "offset_bits"_a,
             nb::call_guard<nb::gil_scoped_release>())
        .def_static("bytes_needed", &FootprintTable::bytes_needed, "ellipse"_a, "offset_bits"_a)
        .def("weights_at", [](const FootprintTable& self, int fx, int fy) { return self.weights_at(fx, fy); },
             "fx"_a, "fy"_a)
        .def_prop_ro("offset_bits", &FootprintTable::offset_bits)
        .def_prop_ro("width", &FootprintTable::width)
        .def_prop_ro("height", &FootprintTable::height)
        .def_prop_ro("bytes", &FootprintTable::bytes);
    nb::class_<CellView>(m, "CellMap")
        .def("__init__", [](CellView* self, const Map& x, const Map& y, const std::array<Axis, 3>& axes) {
            new (self) CellView(cell_view(x, y, axes));
        }, "x"_a, "y"_a, "axes"_a);
    nb::class_<ImageMemory>(m, "ImageMemory")
        .def(nb::init<int, int>(), "width"_a, "height"_a)
        .def("clear", &ImageMemory::clear)
        .def("snapshot", &snapshot);
    nb::class_<EdgeLayer>(m, "EdgeLayer")
        .def(nb::init<int, int>(), "width"_a, "height"_a)
        .def("draw", &EdgeLayer::draw, "x0"_a, "y0"_a, "x1"_a, "y1"_a, "line_width"_a);
    m.def("published", &published, "image"_a, "front"_a, "back"_a);
    m.def("splat_footprints", &splat_footprints, "image"_a, "spans"_a, "table"_a, "front_to_back"_a, "row_begin"_a,
          "row_end"_a);
    m.def("splat_cells", &splat_cells, "image"_a, "spans"_a, "cells"_a, "front_to_back"_a, "row_begin"_a,
          "row_end"_a);
    m.def("splat_pixels", &splat_pixels, "image"_a, "spans"_a, "front_to_back"_a, "row_begin"_a, "row_end"_a);
}

}  // namespace volsplat
