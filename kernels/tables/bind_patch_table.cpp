#include "bind_patch_table.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "patch_table.h"

namespace volsplat {

namespace nb = nanobind;
using namespace nb::literals;

namespace {

typedef std::array<double, 14> PatchNumbers;

Patch patch_of(const PatchNumbers& n) {
    return {{n[0], n[1]}, {n[2], n[3]}, {n[4], n[5]}, n[6], n[7], {n[8], n[9], n[10]}, {n[11], n[12], n[13]}};
}

template <class Number, class... Sizes>
nb::ndarray<nb::array_api, Number> shared(std::vector<Number>& numbers, Sizes... sizes) {
    return nb::ndarray<nb::array_api, Number>(numbers.data(), {static_cast<std::size_t>(sizes)...}, nb::handle());
}

// Of each density the strength of the greatest opacity, the first of several.
std::vector<int> clearest(const PatchTable& table) {
    std::vector<int> found(kTableEntries);
    for (int n = 0; n < kTableEntries; ++n) {
        for (int strength = 1; strength < kTableEntries; ++strength) {
            const double here = table.opacity[strength * kTableEntries + n];
            if (here > table.opacity[found[n] * kTableEntries + n]) found[n] = strength;
        }
    }
    return found;
}

// The densities and the strengths of which some entry is not transparent.
std::pair<std::vector<int>, std::vector<int>> seen(const PatchTable& table) {
    std::array<bool, kTableEntries> densities{}, strengths{};
    for (int at = 0; at < kPlaneEntries; ++at) {
        if (table.opacity[at] <= 0.0) continue;
        densities[at % kTableEntries] = strengths[at / kTableEntries] = true;
    }
    std::pair<std::vector<int>, std::vector<int>> found;
    for (int n = 0; n < kTableEntries; ++n) {
        if (densities[n]) found.first.push_back(n);
        if (strengths[n]) found.second.push_back(n);
    }
    return found;
}

}  // namespace

void bind_patch_table(nb::module_& m) {
    nb::class_<PatchTable>(m, "PatchTable")
        .def(
            "__init__",
            [](PatchTable* self, const std::vector<PatchNumbers>& numbers) {
                std::vector<Patch> patches;
                for (const PatchNumbers& patch : numbers) patches.push_back(patch_of(patch));
                new (self) PatchTable(patches);
            },
            "patches"_a)
        .def_prop_ro(
            "opacity", [](PatchTable& table) { return shared(table.opacity, kPlaneEntries); },
            nb::rv_policy::reference_internal)
        .def_prop_ro(
            "emit", [](PatchTable& table) { return shared(table.emit, kPlaneEntries, 4); },
            nb::rv_policy::reference_internal)
        .def_prop_ro(
            "refl", [](PatchTable& table) { return shared(table.refl, kPlaneEntries, 4); },
            nb::rv_policy::reference_internal)
        .def("clearest", &clearest)
        .def("seen", &seen);
}

}  // namespace volsplat
