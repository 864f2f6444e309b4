#include "combining.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <stdexcept>

#include "kernels/interpreter_lock.h"
#include "splat_server/kernels/edge_layer.h"
#include "splat_server/kernels/footprint_table.h"

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
        view.axes[n] = {{low, high, stride, first, count}, ascending};
    }
    return view;
}

}  // namespace

void bind_combining(nb::module_& m) {
    nb::class_<KernelProjection>(m, "KernelProjection")
        .def(nb::init<const std::string&, double, double>(), "kernel"_a, "parameter"_a, "radius"_a)
        .def_static(
            "signed",
            [](const std::vector<double>& coefficients, double radius) {
                return KernelProjection(coefficients, radius);
            },
            "coefficients"_a, "radius"_a)
        .def("at_square", &KernelProjection::at_square, "rho_square"_a);
    nb::class_<Ellipse>(m, "Ellipse")
        .def(
            "__init__",
            [](Ellipse* self, double amplitude, double qxx, double qxy, double qyy, double half_width,
               double half_height) { new (self) Ellipse{amplitude, qxx, qxy, qyy, half_width, half_height}; },
            "amplitude"_a, "qxx"_a, "qxy"_a, "qyy"_a, "half_width"_a, "half_height"_a);
    nb::class_<FootprintTable>(m, "FootprintTable")
        .def(nb::init<const KernelProjection&, const Ellipse&, int, int>(), "projection"_a, "ellipse"_a,
             "offset_bits"_a, "threads"_a = 1, nb::call_guard<Unlocked>())
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
    nb::class_<EdgeLayer>(m, "EdgeLayer")
        .def(nb::init<int, int>(), "width"_a, "height"_a)
        .def("draw", &EdgeLayer::draw, "x0"_a, "y0"_a, "x1"_a, "y1"_a, "line_width"_a);
}

}  // namespace volsplat
