// Checks and converts what Python gives, so that the walk itself need not.
#include "slab_walk.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "mapshade_server/kernels/slabs/slab_walk.h"
#include "walk_arguments.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

using BoxOfNeeded = std::tuple<PacketArray, Index3, std::shared_ptr<NeededVoxels>>;
using DensityArray = nb::ndarray<const std::uint8_t, nb::shape<32>, nb::c_contig, nb::device::cpu>;

using NeighbourhoodNumbers = std::tuple<Index3, std::vector<std::vector<std::int64_t>>>;

Neighbourhood neighbourhood_of(const NeighbourhoodNumbers& numbers) {
    const auto& [box, shape] = numbers;
    bool right = !shape.empty() && std::ranges::all_of(box, [](std::int64_t voxels) { return voxels >= 0; });
    for (const auto& row : shape)
        right = right && !row.empty() && std::ranges::all_of(row, [](std::int64_t voxels) { return voxels >= 0; });
    if (!right) throw std::invalid_argument("a neighbourhood reaches 0 voxels and more");
    return {box, shape};
}

// Keeps alive what the walkers borrow.
class PythonSlabWalk {
public:
    PythonSlabWalk(const std::vector<BoxOfNeeded>& boxes, const std::array<int, 3>& axes,
                   const std::array<bool, 3>& ascending, const std::array<VisitNumbers, 3>& visits, const DdaNumbers& x,
                   const DdaNumbers& y, const DdaNumbers& depth, const std::array<std::int64_t, 2>& image,
                   const std::array<double, 2>& reach, const std::array<std::int64_t, 3>& groups, const Index3& dims,
                   const DensityArray& visible, const NeighbourhoodNumbers& look, const NeighbourhoodNumbers& inner,
                   const NeighbourhoodNumbers& spread, const std::array<double, 2>& overshoot,
                   std::optional<TileArray> closed_tiles, const std::vector<LineNumbers>& regions, std::int64_t walkers,
                   const std::array<std::int64_t, 2>& limits) {
        const auto [count, lead, before] = groups;
        const SlabPlan plan{{axes,
                             ascending,
                             {visits_of(visits[0]), visits_of(visits[1]), visits_of(visits[2])},
                             dda_of(x),
                             dda_of(y),
                             {},
                             image[0],
                             image[1],
                             reach[0],
                             reach[1],
                             {}},
                            dda_of(depth),
                            lead,
                            before,
                            count};
        closed_tiles_ = std::move(closed_tiles);
        if (closed_tiles_) check_tiles(*closed_tiles_, plan.walk);
        const std::vector<Lines> lines = regions_of(regions, plan.walk.height);
        Need need{{},
                  neighbourhood_of(look),
                  neighbourhood_of(inner),
                  neighbourhood_of(spread),
                  overshoot[0],
                  overshoot[1],
                  {},
                  {}};
        std::memcpy(need.visible.data(), visible.data(), sizeof(need.visible));
        std::vector<NeededBox> needed;
        for (const auto& [packets, low, kept] : boxes) {
            const Index3 size = size_of(packets);
            if (!kept || kept->size() != size)
                throw std::invalid_argument("a box's needed voxels are not those of its voxel packets");
            for (int axis = 0; axis < 3; ++axis) {
                need.before[axis] = low[axis] > 0;
                need.behind[axis] = low[axis] + size[axis] < dims[axis];
            }
            needed.push_back({low, size, packets.data(), kept->rows_along(axes[2], need)});
            packets_.push_back(packets);
        }
        walk_ =
            std::make_unique<SlabWalk>(plan, std::move(needed), lines, closed_tiles_ ? closed_tiles_->data() : nullptr,
                                       walkers, limits_of(limits[0], limits[1]));
        for (std::int64_t n = 0; n < walk_->parts.count(); ++n)
            walkers_.push_back(std::make_unique<SlabWalker>(*walk_, n));
    }

    std::size_t walkers() const { return walkers_.size(); }
    BatchWalker& walker(std::size_t number) { return *walkers_.at(number); }

private:
    std::optional<TileArray> closed_tiles_;
    std::vector<PacketArray> packets_;
    std::unique_ptr<SlabWalk> walk_;
    std::vector<std::unique_ptr<SlabWalker>> walkers_;
};

}  // namespace

void bind_slab_walk(nb::module_& m) {
    nb::class_<NeededVoxels>(m, "NeededVoxels").def(nb::init<const Index3&>(), "size"_a);

    nb::class_<PythonSlabWalk>(m, "SlabWalk")
        .def(nb::init<const std::vector<BoxOfNeeded>&, const std::array<int, 3>&, const std::array<bool, 3>&,
                      const std::array<VisitNumbers, 3>&, const DdaNumbers&, const DdaNumbers&, const DdaNumbers&,
                      const std::array<std::int64_t, 2>&, const std::array<double, 2>&,
                      const std::array<std::int64_t, 3>&, const Index3&, const DensityArray&,
                      const NeighbourhoodNumbers&, const NeighbourhoodNumbers&, const NeighbourhoodNumbers&,
                      const std::array<double, 2>&, std::optional<TileArray>, const std::vector<LineNumbers>&,
                      std::int64_t, const std::array<std::int64_t, 2>&>(),
             "boxes"_a, "axes"_a, "ascending"_a, "visits"_a, "x"_a, "y"_a, "depth"_a, "image"_a, "reach"_a, "groups"_a,
             "dims"_a, "visible"_a, "look"_a, "inner"_a, "spread"_a, "overshoot"_a, "closed_tiles"_a.none(),
             "regions"_a, "walkers"_a, "limits"_a)
        .def_prop_ro("walkers", &PythonSlabWalk::walkers)
        .def("walker", &PythonSlabWalk::walker, "number"_a, nb::rv_policy::reference_internal);
}

}  // namespace volsplat
