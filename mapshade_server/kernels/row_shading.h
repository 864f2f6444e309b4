// Shades a row of voxel packets: which samples can be seen, their opacity codes, and the bytes that index the tables.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "paths/path_kernels.h"
#include "walk_plan.h"

namespace volsplat {

// In the order of Field in protocol/scene.py.
enum class Field {
  density, strength, gradient_i, gradient_j, gradient_k, screen_x, screen_y, screen_z, grid_i, grid_j, grid_k
};

// The tables are borrowed: their owner outlives the walk.
struct ShadingTables {
  Field emit, refl, opac, modu;  // the cross-bar
  ColourTables colours;
  std::vector<const std::uint16_t*> opacity;  // distinct tables of 65536 codes, at opac index | modu index << 8
  std::array<int, 27> opacity_of_class;       // by block class: i + 3 j + 9 k
  const std::uint8_t* gradient_bytes;         // 3 x 32768
  std::array<const std::uint8_t*, 3> grid_bytes;  // of each index of i, j, k
};

// Samples of one row at equal steps: the grid place of the first, and how they lie on the screen.
struct SampleRow {
  Index3 ordinals;  // of i, j, k of the first sample
  Index3 doubled;   // the centre of its block
  int opacity;      // number of the opacity table
};

class RowShading {
 public:
  RowShading(const WalkPlan& plan, const ShadingTables& tables, std::size_t longest_row);

  // Finds the visible ones of n samples, given by rising ordinal; returns how many.
  std::size_t select(const SampleRow& row, const std::uint32_t* packets, std::size_t n);

  // What `select` found, ready to be coloured.
  SurvivingSamples survivors() const;

 private:
  // The codes and the visibility of one opacity table, made at its first use.
  struct Opacity {
    std::vector<std::uint16_t> by_packet;  // at density | strength << 8, where only these index the tables
    std::vector<std::uint32_t> visible;    // a bit for each density | strength << 8 that can be seen
  };

  const Opacity& opacity(int number);
  std::vector<std::uint32_t> visibility(const std::uint16_t* codes) const;
  void fill_field(Field field, const SampleRow& row, std::size_t n, std::uint8_t* out) const;
  std::size_t drop_transparent(const SampleRow& row, std::size_t n);

  const WalkPlan& plan_;
  const ShadingTables& tables_;
  bool opacity_by_packet_;
  std::vector<Opacity> opacities_;
  std::vector<std::uint32_t> positions_, packets_;
  std::vector<std::uint16_t> codes_;
  std::vector<std::uint8_t> emit_, refl_, opac_, modu_;
};

}  // namespace volsplat
