// Checks and converts what Python gives.
#include "slabs.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "kernels/interpreter_lock.h"
#include "splat_server/kernels/passed_light.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

typedef std::array<double, 3> Vector3;
typedef std::array<Vector3, 3> Matrix3;
typedef std::vector<Vector3> Colours;
typedef std::vector<double> Scalars;

// Number by number.
template <class Value, class Plain>
void copy(const Value& value, Plain& plain) {
    if constexpr (std::is_arithmetic_v<Plain>) {
        plain = value;
    } else {
        if (value.size() != std::size(plain)) throw std::invalid_argument("a table has 256 entries");
        for (std::size_t n = 0; n < value.size(); ++n) copy(value[n], plain[n]);
    }
}

Field field_of(int number) {
    if (number < 0 || number > static_cast<int>(Field::grid_k))
        throw std::invalid_argument("the cross-bar names a field that does not exist");
    return static_cast<Field>(number);
}

SlabScene scene_of(const std::array<int, 4>& cross_bar, const Colours& emit, const Colours& refl, const Scalars& opac,
                   const Scalars& modu, const Vector3& light, const Vector3& half_way,
                   const std::array<bool, 3>& switches, double specular_power, const std::array<double, 2>& dimming) {
    SlabScene scene;
    for (std::size_t table = 0; table < cross_bar.size(); ++table) scene.cross_bar[table] = field_of(cross_bar[table]);
    copy(emit, scene.emit), copy(refl, scene.refl), copy(opac, scene.opac), copy(modu, scene.modu);
    copy(light, scene.light), copy(half_way, scene.half_way);
    std::tie(scene.diffuse, scene.specular, scene.two_sided) = std::tuple_cat(switches);
    scene.specular_power = specular_power;
    scene.depth_cue = dimming[0], scene.silhouettes = dimming[1];
    return scene;
}

SlabGrid grid_of(const Matrix3& gradient, const Matrix3& axes, double strength,
                 const std::array<std::array<double, 4>, 3>& screen_bytes, const std::array<std::int64_t, 3>& dims,
                 const std::array<std::int64_t, 3>& factors) {
    SlabGrid grid;
    copy(gradient, grid.gradient), copy(axes, grid.axes), copy(screen_bytes, grid.screen_bytes);
    copy(dims, grid.dims), copy(factors, grid.factors);
    grid.strength = strength;
    return grid;
}

SlabRays rays_of(const std::array<Vector3, 4>& places, const std::array<Vector3, 2>& bounds, double thickness,
                 int baseline) {
    SlabRays rays;
    copy(places[0], rays.origin), copy(places[1], rays.right), copy(places[2], rays.down);
    copy(places[3], rays.behind), copy(bounds[0], rays.low), copy(bounds[1], rays.high);
    rays.thickness = thickness, rays.baseline = baseline;
    return rays;
}

SlabLight light_of(const std::array<double, 3>& size, const Matrix3& to_blocks, const std::array<double, 2>& shares) {
    SlabLight light{};
    copy(size, light.size), copy(to_blocks, light.to_blocks);
    light.shadows = shares[0], light.occlusion = shares[1];
    return light;
}

// A light without what it points to is as good as none.
SlabLight pointing_to(SlabLight light, const nb::object& lamp, const nb::object& sky) {
    if (lamp.is_none() || sky.is_none()) return {};
    const auto &of_lamp = nb::cast<const PassedLight&>(lamp), &of_sky = nb::cast<const PassedLight&>(sky);
    if (of_lamp.dims() != of_sky.dims())
        throw std::invalid_argument("light of a lamp and the sky passes the same blocks");
    light.lamp = of_lamp.shares(), light.sky = of_sky.shares();
    for (int axis = 0; axis < 3; ++axis) light.dims[axis] = of_sky.dims()[axis];
    return light;
}

std::vector<std::uint16_t> depths_of(const nb::bytes& bytes) {
    std::vector<std::uint16_t> depths(bytes.size() / 2);
    const auto* const raw = static_cast<const unsigned char*>(bytes.data());
    for (std::size_t n = 0; n < depths.size(); ++n)
        depths[n] = static_cast<std::uint16_t>(raw[2 * n] | raw[2 * n + 1] << 8);
    return depths;
}

}  // namespace

void bind_slabs(nb::module_& m) {
    nb::class_<SlabTable>(m, "SlabTable")
        .def(
            "__init__",
            [](SlabTable* self, const KernelProjection& kernel, double amplitude, const Matrix3& form,
               const Vector3& half_extents, int offset_bits,
               bool wide) { new (self) SlabTable(kernel, {amplitude, form, half_extents}, offset_bits, wide); },
            "kernel"_a, "amplitude"_a, "form"_a, "half_extents"_a, "offset_bits"_a, "wide"_a,
            nb::call_guard<Unlocked>())
        .def_prop_ro("pixel_bytes", &SlabTable::pixel_bytes)
        .def_prop_ro("width", &SlabTable::width)
        .def_prop_ro("height", &SlabTable::height);
    nb::class_<SlabScene>(m, "SlabScene")
        .def(
            "__init__",
            [](SlabScene* self, const std::array<int, 4>& cross_bar, const Colours& emit, const Colours& refl,
               const Scalars& opac, const Scalars& modu, const Vector3& light, const Vector3& half_way,
               const std::array<bool, 3>& switches, double specular_power, const std::array<double, 2>& dimming) {
                new (self) SlabScene(
                    scene_of(cross_bar, emit, refl, opac, modu, light, half_way, switches, specular_power, dimming));
            },
            "cross_bar"_a, "emit"_a, "refl"_a, "opac"_a, "modu"_a, "light"_a, "half_way"_a, "switches"_a,
            "specular_power"_a, "dimming"_a);
    nb::class_<SlabGrid>(m, "SlabGrid")
        .def(
            "__init__",
            [](SlabGrid* self, const Matrix3& gradient, const Matrix3& axes, double strength,
               const std::array<std::array<double, 4>, 3>& screen_bytes, const std::array<std::int64_t, 3>& dims,
               const std::array<std::int64_t, 3>& factors) {
                new (self) SlabGrid(grid_of(gradient, axes, strength, screen_bytes, dims, factors));
            },
            "gradient"_a, "axes"_a, "strength"_a, "screen_bytes"_a, "dims"_a, "factors"_a);
    nb::class_<PassedLight>(m, "PassedLight")
        .def(
            "__init__",
            [](PassedLight* self, const nb::bytes& depths, double unit, const std::array<int, 3>& dims,
               const std::vector<std::pair<Vector3, double>>& steps) {
                std::vector<LightStep> all;
                for (const auto& [step, length] : steps) all.push_back({step, length});
                const std::vector<std::uint16_t> of_blocks = depths_of(depths);
                const Unlocked unlocked;
                new (self) PassedLight(of_blocks, unit, dims, all);
            },
            "depths"_a, "unit"_a, "dims"_a, "steps"_a)
        .def(
            "share",
            [](const PassedLight& self, int i, int j, int k) {
                const auto& dims = self.dims();
                if (std::min({i, j, k}) < 0 || i >= dims[0] || j >= dims[1] || k >= dims[2])
                    throw std::out_of_range("there is no such block");
                return self.shares()[(k * dims[1] + j) * dims[0] + i];
            },
            "i"_a, "j"_a, "k"_a);
    nb::class_<SlabLight>(m, "SlabLight")
        .def(
            "__init__",
            [](SlabLight* self, const std::array<double, 3>& size, const Matrix3& to_blocks,
               const std::array<double, 2>& shares) { new (self) SlabLight(light_of(size, to_blocks, shares)); },
            "size"_a, "to_blocks"_a, "shares"_a);
    nb::class_<PythonSlabs>(m, "Slabs")
        .def(
            "__init__",
            [](PythonSlabs* self, nb::object table, const SlabScene& scene, const SlabGrid& grid, int planes, int lead,
               int baseline, double thickness, const std::array<Vector3, 4>& places,
               const std::array<Vector3, 2>& bounds, const SlabLight& light, nb::object lamp, nb::object sky,
               const PatchTable* plane) {
                const SlabTable* slices = &nb::cast<const SlabTable&>(table);
                new (self) PythonSlabs{std::move(table),
                                       lamp,
                                       sky,
                                       SlabShading(scene, grid, rays_of(places, bounds, thickness, baseline),
                                                   pointing_to(light, lamp, sky), plane),
                                       {slices, nullptr, planes, lead}};
                self->frame.shading = &self->shading;
            },
            "table"_a, "scene"_a, "grid"_a, "planes"_a, "lead"_a, "baseline"_a, "thickness"_a, "places"_a, "bounds"_a,
            "light"_a, "lamp"_a.none(), "sky"_a.none(), "plane"_a.none());
}

}  // namespace volsplat
