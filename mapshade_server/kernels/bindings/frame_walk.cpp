// Checks and converts what Python gives, so that the walk itself need not.
#include "frame_walk.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.h"
#include "kernels/tile_map.h"
#include "mapshade_server/kernels/shading_tables.h"
#include "mapshade_server/kernels/walk/walker.h"
#include "walk_arguments.h"

namespace volsplat {

using namespace nb::literals;

namespace {

using ColourArray = nb::ndarray<const float, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using OpacityArray = nb::ndarray<const std::uint16_t, nb::shape<65536>, nb::c_contig, nb::device::cpu>;
using VisibilityArray = nb::ndarray<const std::uint8_t, nb::shape<64>, nb::c_contig, nb::device::cpu>;
using LightArray = nb::ndarray<const float, nb::shape<32768>, nb::c_contig, nb::device::cpu>;
using GradientByteArray = nb::ndarray<const std::uint8_t, nb::shape<3, 32768>, nb::c_contig, nb::device::cpu>;
using GridByteArray = nb::ndarray<const std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using ClassifiedBox = std::tuple<PacketArray, Index3, std::shared_ptr<ClassifiedRows>>;

ShadingTables tables_of(const std::array<int, 4>& cross_bar, const std::vector<OpacityArray>& opacity,
                        const std::array<int, 27>& opacity_of_class, const VisibilityArray& visibility) {
    ShadingTables tables{};
    Field* fields[4] = {&tables.emit, &tables.refl, &tables.opac, &tables.modu};
    for (int table = 0; table < 4; ++table) {
        if (cross_bar[table] < 0 || cross_bar[table] > static_cast<int>(Field::grid_k)) {
            throw std::invalid_argument("the cross-bar names a field that does not exist");
        }
        *fields[table] = static_cast<Field>(cross_bar[table]);
    }
    for (const OpacityArray& codes : opacity) tables.opacity.push_back(codes.data());
    for (int number : opacity_of_class) {
        if (number < 0 || number >= static_cast<int>(opacity.size())) {
            throw std::invalid_argument("a block class names an opacity table that does not exist");
        }
    }
    tables.opacity_of_class = opacity_of_class;
    static_assert(sizeof(Visibility) == 64);
    std::memcpy(&tables.visibility, visibility.data(), sizeof(Visibility));
    return tables;
}

// Whether colours are those of a plane rather than of a field.
bool are_of_plane(const ColourArray& emit, const ColourArray& refl) {
    const std::size_t entries = emit.shape(0);
    if (refl.shape(0) != entries || (entries != kTableEntries && entries != kPlaneEntries)) {
        throw std::invalid_argument("colours must be those of 256 bytes or of 65536 pairs of them");
    }
    return entries == kPlaneEntries;
}

// Keeps alive what the walk and its walkers borrow.
class PythonFrameWalk {
public:
    PythonFrameWalk(std::vector<ClassifiedBox> boxes, const std::array<int, 3>& axes,
                    const std::array<bool, 3>& ascending, const std::array<std::array<std::int64_t, 5>, 3>& visits,
                    const std::array<std::int64_t, 4>& x, const std::array<std::int64_t, 4>& y,
                    const std::array<std::array<std::int64_t, 4>, 3>& screen_index,
                    const std::array<std::int64_t, 2>& image, const std::array<double, 2>& reach,
                    const std::array<std::uint64_t, 2>& thresholds, const std::array<int, 4>& cross_bar,
                    ColourArray emit, ColourArray refl, LightArray light, std::vector<OpacityArray> opacity,
                    const std::array<int, 27>& opacity_of_class, const VisibilityArray& visibility,
                    GradientByteArray gradient_bytes, std::array<GridByteArray, 3> grid_bytes,
                    std::optional<TileArray> closed_tiles, const std::vector<std::array<std::int64_t, 2>>& regions,
                    std::int64_t walkers, const std::array<std::int64_t, 2>& limits);

    std::size_t walkers() const { return walkers_.size(); }
    BatchWalker& walker(std::size_t number) { return *walkers_.at(number); }

private:
    // What the walk points into
    std::vector<ClassifiedBox> boxes_;
    ColourArray emit_, refl_;
    LightArray light_;
    std::vector<OpacityArray> opacity_;
    GradientByteArray gradient_bytes_;
    std::array<GridByteArray, 3> grid_bytes_;
    std::optional<TileArray> closed_tiles_;

    std::unique_ptr<FrameWalk> walk_;
    std::vector<std::unique_ptr<Walker>> walkers_;
};

PythonFrameWalk::PythonFrameWalk(
    std::vector<ClassifiedBox> boxes, const std::array<int, 3>& axes, const std::array<bool, 3>& ascending,
    const std::array<std::array<std::int64_t, 5>, 3>& visits, const std::array<std::int64_t, 4>& x,
    const std::array<std::int64_t, 4>& y, const std::array<std::array<std::int64_t, 4>, 3>& screen_index,
    const std::array<std::int64_t, 2>& image, const std::array<double, 2>& reach,
    const std::array<std::uint64_t, 2>& thresholds, const std::array<int, 4>& cross_bar, ColourArray emit,
    ColourArray refl, LightArray light, std::vector<OpacityArray> opacity, const std::array<int, 27>& opacity_of_class,
    const VisibilityArray& visibility, GradientByteArray gradient_bytes, std::array<GridByteArray, 3> grid_bytes,
    std::optional<TileArray> closed_tiles, const std::vector<std::array<std::int64_t, 2>>& regions,
    std::int64_t walkers, const std::array<std::int64_t, 2>& limits)
    : boxes_(std::move(boxes)),
      emit_(std::move(emit)),
      refl_(std::move(refl)),
      light_(std::move(light)),
      opacity_(std::move(opacity)),
      gradient_bytes_(std::move(gradient_bytes)),
      grid_bytes_(std::move(grid_bytes)),
      closed_tiles_(std::move(closed_tiles)) {
    const WalkPlan plan{axes,
                        ascending,
                        {visits_of(visits[0]), visits_of(visits[1]), visits_of(visits[2])},
                        dda_of(x),
                        dda_of(y),
                        {dda_of(screen_index[0]), dda_of(screen_index[1]), dda_of(screen_index[2])},
                        image[0],
                        image[1],
                        reach[0],
                        reach[1],
                        {thresholds[0], thresholds[1]}};
    if (closed_tiles_) check_tiles(*closed_tiles_, plan);

    ShadingTables tables = tables_of(cross_bar, opacity_, opacity_of_class, visibility);
    tables.colours = {emit_.data(), refl_.data(), light_.data(), are_of_plane(emit_, refl_)};
    tables.gradient_bytes = gradient_bytes_.data();
    for (int axis = 0; axis < 3; ++axis) {
        if (static_cast<std::int64_t>(grid_bytes_[axis].size()) < plan.visits[axis].high) {
            throw std::invalid_argument("the grid's bytes do not cover the bounds");
        }
        tables.grid_bytes[axis] = grid_bytes_[axis].data();
    }

    std::vector<PacketBox> packet_boxes;
    for (const auto& [packets, low, classified] : boxes_) {
        if (!classified || classified->size() != size_of(packets)) {
            throw std::invalid_argument("a box's classified rows are not those of its voxel packets");
        }
        packet_boxes.push_back({packets.data(), low, size_of(packets), classified});
    }
    const std::vector<Lines> lines = regions_of(regions, plan.height);
    walk_ =
        std::make_unique<FrameWalk>(plan, tables, packet_boxes, lines, closed_tiles_ ? closed_tiles_->data() : nullptr,
                                    walkers, limits_of(limits[0], limits[1]));
    for (std::int64_t n = 0; n < walk_->parts.count(); ++n) walkers_.push_back(std::make_unique<Walker>(*walk_, n));
}

}  // namespace

void bind_frame_walk(nb::module_& m) {
    nb::class_<ClassifiedRows>(m, "ClassifiedRows")
        .def(nb::init<const Index3&, double>(), "size"_a, "share"_a)
        .def_prop_ro("bytes", &ClassifiedRows::bytes)
        .def_prop_ro("axes", &ClassifiedRows::axes);

    nb::class_<PythonFrameWalk>(m, "FrameWalk")
        .def(nb::init<std::vector<ClassifiedBox>, const std::array<int, 3>&, const std::array<bool, 3>&,
                      const std::array<std::array<std::int64_t, 5>, 3>&, const std::array<std::int64_t, 4>&,
                      const std::array<std::int64_t, 4>&, const std::array<std::array<std::int64_t, 4>, 3>&,
                      const std::array<std::int64_t, 2>&, const std::array<double, 2>&,
                      const std::array<std::uint64_t, 2>&, const std::array<int, 4>&, ColourArray, ColourArray,
                      LightArray, std::vector<OpacityArray>, const std::array<int, 27>&, const VisibilityArray&,
                      GradientByteArray, std::array<GridByteArray, 3>, std::optional<TileArray>,
                      const std::vector<std::array<std::int64_t, 2>>&, std::int64_t,
                      const std::array<std::int64_t, 2>&>(),
             "boxes"_a, "axes"_a, "ascending"_a, "visits"_a, "x"_a, "y"_a, "screen_index"_a, "image"_a, "reach"_a,
             "thresholds"_a, "cross_bar"_a, "emit"_a, "refl"_a, "light"_a, "opacity"_a, "opacity_of_class"_a,
             "visibility"_a, "gradient_bytes"_a, "grid_bytes"_a, "closed_tiles"_a.none(), "regions"_a, "walkers"_a,
             "limits"_a)
        .def_prop_ro("walkers", &PythonFrameWalk::walkers)
        .def("walker", &PythonFrameWalk::walker, "number"_a, nb::rv_policy::reference_internal);
}

}  // namespace volsplat
