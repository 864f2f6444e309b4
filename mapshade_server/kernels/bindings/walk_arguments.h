// What the bindings of both walks take alike.
#pragma once

#include <nanobind/ndarray.h>

#include <array>
#include <cstdint>
#include <vector>

#include "mapshade_server/kernels/batches/batch_walker.h"
#include "mapshade_server/kernels/walk/regions.h"
#include "mapshade_server/kernels/walk/walk_plan.h"

namespace volsplat {

using PacketArray =
    nanobind::ndarray<const std::uint32_t, nanobind::ndim<3>, nanobind::c_contig, nanobind::device::cpu>;
using TileArray = nanobind::ndarray<const std::uint64_t, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;
using DdaNumbers = std::array<std::int64_t, 4>;
using VisitNumbers = std::array<std::int64_t, 5>;
using LineNumbers = std::array<std::int64_t, 2>;

Dda dda_of(const DdaNumbers& numbers);
AxisVisits visits_of(const VisitNumbers& numbers);
Index3 size_of(const PacketArray& packets);

// Throw std::invalid_argument.
void check_tiles(const TileArray& tiles, const WalkPlan& plan);
std::vector<Lines> regions_of(const std::vector<LineNumbers>& regions, std::int64_t lines);
BatchLimits limits_of(std::int64_t max_packets, std::int64_t max_voxels);

}  // namespace volsplat
