// Checks boxes, releases the GIL, and wraps results.
#include "preprocessing.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "arrays.h"
#include "kernels/interpreter_lock.h"
#include "kernels/large_memory.h"
#include "mapshade_server/kernels/shading_tables.h"
#include "mapshade_server/kernels/voxel_packets.h"

namespace volsplat {

using namespace nb::literals;

namespace {

using Matrix3 = std::array<double, 9>;  // row-major

Interior interior_of(const SourceVolume& source, const Index3& low, const Index3& size) {
    for (int axis = 0; axis < 3; ++axis) {
        if (low[axis] < 0 || size[axis] < 0 || low[axis] + size[axis] > source.size[axis]) {
            throw std::invalid_argument("the box does not lie within the source array");
        }
    }
    return {low, size};
}

Blocks blocks_of(const Index3& begin, const Index3& block_size, const Index3& block_count, const Index3& size) {
    for (int axis = 0; axis < 3; ++axis) {
        if (begin[axis] < 0 || block_size[axis] < 1 ||
            begin[axis] + size[axis] > block_size[axis] * block_count[axis]) {
            throw std::invalid_argument("the box does not lie within the blocks");
        }
    }
    return {begin, block_size, block_count};
}

// The second scalar, which must be that of the box alone.
std::optional<SourceVolume> second_of(const std::optional<SourceArray>& second, const Index3& size) {
    if (!second) return std::nullopt;
    const SourceVolume volume = source_of(*second);
    if (volume.size != size) throw std::invalid_argument("the second scalar must have the shape of the box");
    return volume;
}

nb::tuple python_survey(const SourceArray& source, const Index3& low, const Index3& size, const Matrix3& matrix) {
    const SourceVolume volume = source_of(source);
    const Interior interior = interior_of(volume, low, size);
    RowExtremes extremes;
    {
        const Unlocked unlocked;
        extremes = survey(volume, interior, matrix);
    }
    return nb::make_tuple(extremes.low, extremes.high, extremes.max_gradient, extremes.no_data);
}

nb::tuple python_histograms(const SourceArray& source, const Index3& low, const Index3& size, const Matrix3& matrix,
                            const std::optional<SourceArray>& second, const std::pair<double, double>& density,
                            const std::pair<double, double>& strength, const Index3& begin, const Index3& block_size,
                            const Index3& block_count) {
    const SourceVolume volume = source_of(source);
    const Interior interior = interior_of(volume, low, size);
    const std::optional<SourceVolume> other = second_of(second, size);
    const Blocks blocks = blocks_of(begin, block_size, block_count, size);
    Histograms counts;
    {
        const Unlocked unlocked;
        counts = histograms(volume, interior, matrix, other ? &*other : nullptr, {density.first, density.second},
                            {strength.first, strength.second}, blocks);
    }
    return nb::make_tuple(owned_array(std::move(counts.density), kHistogramBins),
                          owned_array(std::move(counts.strength), kHistogramBins),
                          owned_array(std::move(counts.extremes), 2, block_count[2], block_count[1], block_count[0]));
}

nb::object python_empty_packets(const Index3& size) {
    for (std::int64_t extent : size) {
        if (extent < 0) throw std::invalid_argument("a box of voxel packets needs a size");
    }
    return packet_memory(size).array;
}

nb::object python_pack(const SourceArray& source, const Index3& low, const Index3& size, const Matrix3& matrix,
                       const std::optional<SourceArray>& second, double window_low, double density_scale,
                       double strength_low, double strength_scale, bool octahedral) {
    const SourceVolume volume = source_of(source);
    const Interior interior = interior_of(volume, low, size);
    const std::optional<SourceVolume> other = second_of(second, size);
    const PacketMemory memory = packet_memory(size);
    {
        const Unlocked unlocked;
        pack(volume, interior, matrix, other ? &*other : nullptr,
             {window_low, density_scale, strength_low, strength_scale, octahedral}, memory.packets);
    }
    return memory.array;
}

Directions directions_named(const std::string& code) {
    if (code == "paper") return Directions::kPaper;
    if (code == "octahedral") return Directions::kOctahedral;
    if (code == "rough") return Directions::kRough;
    throw std::invalid_argument("there is no code of directions " + code);
}

nb::object python_direction_vectors(const std::string& code) {
    const DirectionTable& directions = direction_table(directions_named(code));
    std::vector<double> vectors;
    for (int code = 0; code < kDirectionCodes; ++code) {
        vectors.insert(vectors.end(), {directions.x[code], directions.y[code], directions.z[code]});
    }
    return owned_array(std::move(vectors), kDirectionCodes, 3);
}

nb::object python_gradient_bytes(const std::string& code, const std::array<Vector3, 3>& axes) {
    return owned_array(gradient_bytes(directions_named(code), axes), 3, kDirectionCodes);
}

nb::object python_light_table(const std::string& code, const Vector3& light, const Vector3& half, bool diffuse,
                              bool specular, bool two_sided, double specular_power, const RoughLight* rough) {
    const Directions directions = directions_named(code);
    if (directions == Directions::kRough && !rough) throw std::invalid_argument("rough directions need their light");
    const Lighting lighting{
        {light[0], light[1], light[2]}, {half[0], half[1], half[2]}, diffuse, specular, two_sided, specular_power};
    return owned_array(light_table(directions, lighting, rough), kDirectionCodes);
}

void make_rough_light(RoughLight* self, const std::vector<Cosines>& roughness, bool two_sided, double specular_power) {
    if (roughness.size() != kRoughnesses) throw std::invalid_argument("directions have four roughnesses");
    new (self) RoughLight(roughness, two_sided, specular_power);
}

nb::object python_colour_table(const std::vector<Vector3>& colours) {
    if (colours.size() != kTableEntries) throw std::invalid_argument("a colour table needs 256 entries");
    std::vector<float> table;
    for (const Vector3& colour : colours) {
        for (double channel : colour) table.push_back(static_cast<float>(channel));
        table.push_back(0.0f);
    }
    return owned_array(std::move(table), kTableEntries, 4);
}

nb::object python_opacity_table(const std::vector<double>& opac, const std::vector<double>& modu, double exponent) {
    if (opac.size() != kTableEntries || modu.size() != kTableEntries) {
        throw std::invalid_argument("a scalar table needs 256 entries");
    }
    std::vector<std::uint16_t> codes = opacity_table(opac.data(), modu.data(), exponent);
    codes.resize(codes.size() + kSpare);
    return owned_array(std::move(codes), kTableEntries * kTableEntries);
}

nb::object python_plane_opacity_codes(
    const nb::ndarray<const double, nb::shape<kPlaneEntries>, nb::c_contig, nb::device::cpu>& opacities,
    double exponent) {
    std::vector<std::uint16_t> codes = plane_opacity_codes(opacities.data(), exponent);
    codes.resize(codes.size() + kSpare);
    return owned_array(std::move(codes), kPlaneEntries);
}

}  // namespace

void bind_preprocessing(nb::module_& m) {
    m.def("give_freed_memory_back", &give_freed_memory_back);
    m.def("survey", &python_survey, "source"_a, "low"_a, "size"_a, "matrix"_a);
    m.def("histograms", &python_histograms, "source"_a, "low"_a, "size"_a, "matrix"_a, "second"_a, "density"_a,
          "strength"_a, "begin"_a, "block_size"_a, "block_count"_a);
    m.def("empty_packets", &python_empty_packets, "size"_a);
    m.def("pack", &python_pack, "source"_a, "low"_a, "size"_a, "matrix"_a, "second"_a, "window_low"_a,
          "density_scale"_a, "strength_low"_a, "strength_scale"_a, "octahedral"_a);
    m.def(
        "power", [](double base, double exponent) { return map_shade_kernels().power(base, exponent); }, "base"_a,
        "exponent"_a);
    m.def("direction_vectors", &python_direction_vectors, "directions"_a);
    m.def("gradient_bytes", &python_gradient_bytes, "directions"_a, "axes"_a);
    nb::class_<RoughLight>(m, "RoughLight")
        .def("__init__", &make_rough_light, "roughness"_a, "two_sided"_a, "specular_power"_a);
    m.def("light_table", &python_light_table, "directions"_a, "light"_a, "half"_a, "diffuse"_a, "specular"_a,
          "two_sided"_a, "specular_power"_a, "rough"_a.none());
    m.def("colour_table", &python_colour_table, "colours"_a);
    m.def("opacity_table", &python_opacity_table, "opac"_a, "modu"_a, "exponent"_a);
    m.def("plane_opacity_codes", &python_plane_opacity_codes, "opacities"_a, "exponent"_a);
}

}  // namespace volsplat
