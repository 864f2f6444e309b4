// FrameWalk as Python sees it: keeps alive what the walk borrows, and hands out batches as memoryviews.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <memory>
#include <optional>
#include <tuple>
#include <vector>

#include "frame_walk.h"
#include "python_arrays.h"

namespace volsplat {

using PacketArray = nb::ndarray<const std::uint32_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using ColourArray = nb::ndarray<const float, nb::shape<256, 4>, nb::c_contig, nb::device::cpu>;
using OpacityArray = nb::ndarray<const std::uint16_t, nb::shape<65536>, nb::c_contig, nb::device::cpu>;
using VisibilityArray = nb::ndarray<const std::uint8_t, nb::shape<64>, nb::c_contig, nb::device::cpu>;
using LightArray = nb::ndarray<const float, nb::shape<32768>, nb::c_contig, nb::device::cpu>;
using GradientByteArray = nb::ndarray<const std::uint8_t, nb::shape<3, 32768>, nb::c_contig, nb::device::cpu>;
using GridByteArray = nb::ndarray<const std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using TileArray = nb::ndarray<const std::uint64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using PythonBox = std::tuple<PacketArray, Index3, std::shared_ptr<ClassifiedRows>>;

class PythonFrameWalk {
 public:
  PythonFrameWalk(std::vector<PythonBox> boxes, const std::array<int, 3>& axes, const std::array<bool, 3>& ascending,
                  const std::array<std::array<std::int64_t, 5>, 3>& visits, const std::array<std::int64_t, 4>& x,
                  const std::array<std::int64_t, 4>& y, const std::array<std::array<std::int64_t, 4>, 3>& screen_index,
                  const std::array<std::int64_t, 2>& image, const std::array<double, 2>& reach,
                  const std::array<int, 4>& cross_bar, ColourArray emit, ColourArray refl, LightArray light,
                  std::vector<OpacityArray> opacity, const std::array<int, 27>& opacity_of_class,
                  const VisibilityArray& visibility, GradientByteArray gradient_bytes,
                  std::array<GridByteArray, 3> grid_bytes, std::optional<TileArray> closed_tiles);

  // (runs, packets, run count, packet count, (sheet, row) reached, last, voxels visited)
  nb::tuple next_batch(std::int64_t max_packets, std::int64_t max_voxels);

 private:
  // What the walk points into
  std::vector<PythonBox> boxes_;
  ColourArray emit_, refl_;
  LightArray light_;
  std::vector<OpacityArray> opacity_;
  GradientByteArray gradient_bytes_;
  std::array<GridByteArray, 3> grid_bytes_;
  std::optional<TileArray> closed_tiles_;

  std::unique_ptr<FrameWalk> walk_;
};

}  // namespace volsplat
