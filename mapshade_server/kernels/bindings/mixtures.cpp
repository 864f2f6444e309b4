// Checks arrays, releases the GIL, and wraps results.
#include "mapshade_server/kernels/mixtures.h"

#include <nanobind/stl/array.h>

#include <algorithm>
#include <stdexcept>

#include "arrays.h"
#include "kernels/interpreter_lock.h"
#include "kernels/tables/patch_table.h"
#include "mapshade_server/kernels/level_columns.h"
#include "mapshade_server/kernels/reflected_light.h"
#include "mixtures.h"

namespace volsplat {

using namespace nb::literals;

namespace {

using Packets = nb::ndarray<const std::uint32_t, nb::ndim<3>, nb::device::cpu>;
using Keys = nb::ndarray<const std::uint32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Counts = nb::ndarray<const std::uint64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

PacketView view_of(const Packets& packets) {
    PacketView view{packets.data(), {}, {}};
    for (int axis = 0; axis < 3; ++axis) {
        view.size[axis] = static_cast<std::int64_t>(packets.shape(2 - axis));
        view.step[axis] = packets.stride(2 - axis);
    }
    return view;
}

void check_entries(const Keys& keys, const Counts& counts) {
    if (keys.shape(0) != counts.shape(0)) throw std::invalid_argument("each key needs a count");
    constexpr std::uint32_t kFiner = (1u << kBinBits) - 1;
    for (std::size_t n = 0; n < keys.shape(0); ++n) {
        const std::uint32_t key = keys.data()[n];
        if (key >> kBinBits >= kNoDataBin || (key & kFiner) > kNoDataBin || counts.data()[n] == 0 ||
            (n > 0 && key <= keys.data()[n - 1])) {
            throw std::invalid_argument("entries of a mixture ascend by keys of two bins, and count something");
        }
    }
}

void check_rows(const Table& table, std::size_t rows) {
    if (table.shape(0) != rows) throw std::invalid_argument("a table of a mixture has a row for each of its entries");
}

MixtureEntries entries_of(const Keys& keys, const Counts& counts, int left_open) {
    check_entries(keys, counts);
    if (left_open < 0 || left_open > 8) throw std::invalid_argument("a mixture leaves 0 to 8 bits of densities open");
    return {{keys.data(), keys.data() + keys.shape(0)}, {counts.data(), counts.data() + counts.shape(0)}, left_open};
}

template <class Number>
nb::object copied(const std::vector<Number>& numbers) {
    return owned_array(std::vector<Number>(numbers), numbers.size());
}

using Rows = nb::ndarray<const std::uint32_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

using Ends = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

using Factors = std::array<int, 3>;

void check_columns(const Rows& rows, const Ends& ends, int axis, const Factors& factors, const Table& finer,
                   const Table& coarser) {
    std::int64_t begin = 0;
    const int abreast = axis == ColumnView::kNoAxis ? 1 : ColumnView::kBundle;
    for (std::size_t n = 0; n < ends.shape(0); begin = ends.data()[n++])
        if (ends.data()[n] < begin || ends.data()[n] % abreast != 0)
            throw std::invalid_argument("columns end one after the other, those of a bundle together");
    if (std::ranges::any_of(factors, [](int factor) { return factor != 1 && factor != 2; }))
        throw std::invalid_argument("a level's voxel stands for one or two voxels along each axis");
    if (rows.shape(1) != ColumnView::kRow || static_cast<std::size_t>(begin) != rows.shape(0))
        throw std::invalid_argument("columns have rows of 9 packets, and the last one ends with them");
    if (axis < ColumnView::kNoAxis || axis > 2) throw std::invalid_argument("columns run along three axes or none");
    for (const Table* table : {&finer, &coarser}) {
        check_rows(*table, kPlaneEntries);
        if (table->shape(1) != kLookNumbers) throw std::invalid_argument("what voxels look like takes six numbers");
    }
}

const VoxelLook* looks_of(const Table& table) { return reinterpret_cast<const VoxelLook*>(table.data()); }

// What is emitted, the directions of which something is reflected, and how much.
nb::tuple python_seen(SeenLight seen) {
    const std::size_t n = seen.codes.size();
    return nb::make_tuple(seen.emitted, owned_array(std::move(seen.codes), n),
                          owned_array(std::move(seen.reflected), n, kLightSteps));
}

nb::object python_seen_in_columns(const Rows& rows, const Ends& ends, int axis, bool from_high,
                                  const std::array<bool, 2>& high_first, const Factors& factors, const Table& finer,
                                  const Table& coarser) {
    check_columns(rows, ends, axis, factors, finer, coarser);
    const auto [i, j, k] = factors;
    const ColumnView view{rows.data(), ends.data(), ends.shape(0), axis, from_high, {high_first[0], high_first[1]},
                          {i, j, k}};
    SeenOfLevels seen;
    {
        const Unlocked unlocked;
        seen = seen_in_columns(view, looks_of(finer), looks_of(coarser));
    }
    return nb::make_tuple(python_seen(std::move(seen.finer)), python_seen(std::move(seen.coarser)));
}

nb::object python_reflected_in_steps(const Table& refl, const Table& room, double step) {
    if (refl.shape(0) != room.shape(0) || refl.shape(1) != room.shape(1))
        throw std::invalid_argument("each channel that is reflected has room");
    auto reflected = reflected_in_steps(refl.data(), room.data(), refl.shape(0), static_cast<int>(refl.shape(1)), step);
    return owned_array(std::move(reflected), refl.shape(0), kLightSteps);
}

using LightOfCodes = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Codes = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void make_reflected_light(ReflectedLight* self, const LightOfCodes& light, double step) {
    if (light.shape(0) != kDirectionCodes) throw std::invalid_argument("light is known of every direction code");
    new (self) ReflectedLight({light.data(), light.data() + light.shape(0)}, step);
}

void add_side(ReflectedLight& light, double area, const Codes& codes, const Table& by_step) {
    check_rows(by_step, codes.shape(0));
    if (by_step.shape(1) != kLightSteps) throw std::invalid_argument("light has four steps");
    for (std::size_t n = 0; n < codes.shape(0); ++n)
        if (codes.data()[n] < 0 || codes.data()[n] >= kDirectionCodes)
            throw std::invalid_argument("there is no such direction code");
    light.add(area, codes.data(), by_step.data(), codes.shape(0));
}

}  // namespace

void bind_mixtures(nb::module_& m) {
    nb::class_<MixtureEntries>(m, "MixtureEntries")
        .def(
            "__init__",
            [](MixtureEntries* self, const Keys& keys, const Counts& counts, int left_open) {
                new (self) MixtureEntries(entries_of(keys, counts, left_open));
            },
            "keys"_a, "counts"_a, "left_open"_a)
        .def("add", &MixtureEntries::add, "other"_a, nb::call_guard<Unlocked>())
        .def_prop_ro("keys", [](const MixtureEntries& mixture) { return copied(mixture.keys); })
        .def_prop_ro("counts", [](const MixtureEntries& mixture) { return copied(mixture.counts); })
        .def_ro("left_open", &MixtureEntries::left_open)
        .def(
            "mixed",
            [](const MixtureEntries& mixture, const Table& finer) {
                check_rows(finer, kNoDataBin + 1);
                return owned_array(mixture.mixed(finer.data(), finer.shape(1)), kNoDataBin + 1, finer.shape(1));
            },
            "finer"_a);
    m.def(
        "mixture_of",
        [](const Packets& finer, const Packets& coarser) {
            const PacketView voxels = view_of(finer), means = view_of(coarser);
            const Unlocked unlocked;
            return mixture_of(voxels, means);
        },
        "finer"_a, "coarser"_a);
    m.def(
        "binned",
        [](const Table& table) {
            check_rows(table, kPlaneEntries);
            return owned_array(binned(table.data(), table.shape(1)), kNoDataBin + 1, table.shape(1));
        },
        "table"_a);
    m.def(
        "unbinned",
        [](const Table& table) {
            check_rows(table, kNoDataBin + 1);
            return owned_array(unbinned(table.data(), table.shape(1)), kPlaneEntries, table.shape(1));
        },
        "table"_a);
    m.def("seen_in_columns", &python_seen_in_columns, "rows"_a, "ends"_a, "axis"_a, "from_high"_a, "high_first"_a,
          "factors"_a, "finer"_a, "coarser"_a);
    m.def("reflected_in_steps", &python_reflected_in_steps, "refl"_a, "room"_a, "step"_a);
    nb::class_<ReflectedLight>(m, "ReflectedLight")
        .def("__init__", &make_reflected_light, "light"_a, "step"_a)
        .def("add", &add_side, "area"_a, "codes"_a, "by_step"_a)
        .def("amount", &ReflectedLight::amount, "factor"_a);
}

}  // namespace volsplat
