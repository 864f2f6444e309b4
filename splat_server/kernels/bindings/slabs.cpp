// Checks and converts what Python gives.
#include "slabs.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

typedef std::vector<Vector3> Colours;
typedef std::vector<double> Scalars;

template <class Entries, class Values>
Entries entries_of(const Values& values) {
    Entries entries;
    if (values.size() != entries.size()) throw std::invalid_argument("a table has 256 entries");
    std::copy(values.begin(), values.end(), entries.begin());
    return entries;
}

Field field_of(int number) {
    if (number < 0 || number > static_cast<int>(Field::grid_k))
        throw std::invalid_argument("the cross-bar names a field that does not exist");
    return static_cast<Field>(number);
}

SlabScene scene_of(const std::array<int, 4>& cross_bar, const Colours& emit, const Colours& refl, const Scalars& opac,
                   const Scalars& modu, const Vector3& light, const Vector3& half_way,
                   const std::array<bool, 3>& switches, double specular_power) {
    const auto [diffuse, specular, two_sided] = switches;
    return {{field_of(cross_bar[0]), field_of(cross_bar[1]), field_of(cross_bar[2]), field_of(cross_bar[3])},
            entries_of<ColourEntries>(emit),
            entries_of<ColourEntries>(refl),
            entries_of<ScalarEntries>(opac),
            entries_of<ScalarEntries>(modu),
            light,
            half_way,
            diffuse,
            specular,
            two_sided,
            specular_power};
}

SlabGrid grid_of(const Matrix3& gradient, const Matrix3& axes, double strength,
                 const std::array<std::array<double, 4>, 3>& screen_bytes, const std::array<std::int64_t, 3>& dims,
                 const std::array<std::int64_t, 3>& factors) {
    return {gradient, {axes[0], axes[1], axes[2]}, strength, {screen_bytes[0], screen_bytes[1], screen_bytes[2]}, dims,
            factors};
}

}  // namespace

void bind_slabs(nb::module_& m) {
    nb::class_<SlabTable>(m, "SlabTable")
        .def(
            "__init__",
            [](SlabTable* self, const KernelProjection& kernel, double amplitude, const Matrix3& form,
               const Vector3& half_extents, int offset_bits,
               bool wide) { new (self) SlabTable(kernel, {amplitude, form, half_extents}, offset_bits, wide); },
            "kernel"_a, "amplitude"_a, "form"_a, "half_extents"_a, "offset_bits"_a, "wide"_a)
        .def_prop_ro("width", &SlabTable::width)
        .def_prop_ro("height", &SlabTable::height);
    nb::class_<SlabScene>(m, "SlabScene")
        .def(
            "__init__",
            [](SlabScene* self, const std::array<int, 4>& cross_bar, const Colours& emit, const Colours& refl,
               const Scalars& opac, const Scalars& modu, const Vector3& light, const Vector3& half_way,
               const std::array<bool, 3>& switches, double specular_power) {
                new (self)
                    SlabScene(scene_of(cross_bar, emit, refl, opac, modu, light, half_way, switches, specular_power));
            },
            "cross_bar"_a, "emit"_a, "refl"_a, "opac"_a, "modu"_a, "light"_a, "half_way"_a, "switches"_a,
            "specular_power"_a);
    nb::class_<SlabGrid>(m, "SlabGrid")
        .def(
            "__init__",
            [](SlabGrid* self, const Matrix3& gradient, const Matrix3& axes, double strength,
               const std::array<std::array<double, 4>, 3>& screen_bytes, const std::array<std::int64_t, 3>& dims,
               const std::array<std::int64_t, 3>& factors) {
                new (self) SlabGrid(grid_of(gradient, axes, strength, screen_bytes, dims, factors));
            },
            "gradient"_a, "axes"_a, "strength"_a, "screen_bytes"_a, "dims"_a, "factors"_a);
    nb::class_<PythonSlabs>(m, "Slabs")
        .def(
            "__init__",
            [](PythonSlabs* self, nb::object table, const SlabScene& scene, const SlabGrid& grid, int planes, int lead,
               int before, int baseline, double thickness, const std::array<Vector3, 4>& places,
               const std::array<Vector3, 2>& bounds) {
                const SlabTable* slices = &nb::cast<const SlabTable&>(table);
                new (self) PythonSlabs{std::move(table),
                                       SlabShading(scene, grid),
                                       {slices, nullptr, planes, lead, before, baseline, thickness, places[0],
                                        places[1], places[2], places[3], bounds[0], bounds[1]}};
                self->frame.shading = &self->shading;
            },
            "table"_a, "scene"_a, "grid"_a, "planes"_a, "lead"_a, "before"_a, "baseline"_a, "thickness"_a, "places"_a,
            "bounds"_a);
}

}  // namespace volsplat
