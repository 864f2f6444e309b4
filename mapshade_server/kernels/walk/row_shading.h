// Shades the visible voxels of a row: their opacity codes, and the bytes that index the colour tables.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/field.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "walk_plan.h"

namespace volsplat {

// The tables are borrowed: their owner outlives the walk.
struct ShadingTables {
    Field emit, refl, opac, modu;  // the cross-bar
    ColourTables colours;
    std::vector<const std::uint16_t*> opacity;      // distinct tables of 65536 codes, at opac index | modu index << 8
    std::array<int, 27> opacity_of_class;           // by block class: i + 3 j + 9 k
    Visibility visibility;                          // of voxels that some opacity table may give a code above 0
    const std::uint8_t* gradient_bytes;             // 3 x 32768
    std::array<const std::uint8_t*, 3> grid_bytes;  // of each index of i, j, k
};

// Samples of one row at equal steps: the grid place of the one at position 0.
struct SampleRow {
    Index3 ordinals;  // of i, j, k
    Index3 doubled;   // the centre of its block
    int opacity;      // number of the opacity table
};

class RowShading {
public:
    RowShading(const WalkPlan& plan, const ShadingTables& tables, std::size_t longest_row);

    // Looks up the voxels and drops those that turn out transparent; valid until the next call.
    SurvivingSamples survivors(const SampleRow& row, const VisibleVoxels& voxels);

private:
    // Room for the bytes of a field that is not in the packet itself.
    using Bytes = std::vector<std::uint8_t>;

    bool look_up_opacity(const SampleRow& row, const VisibleVoxels& voxels);
    VisibleVoxels without_transparent(const VisibleVoxels& voxels);
    TableIndices indices(Field field, const SampleRow& row, const VisibleVoxels& voxels, Bytes& bytes) const;

    const MapShadeKernels& kernels_;
    const WalkPlan& plan_;
    const ShadingTables& tables_;
    std::size_t room_;
    std::vector<std::uint16_t> codes_, positions_;
    std::vector<std::uint32_t> packets_;
    Bytes emit_, refl_, opac_, modu_;
};

}  // namespace volsplat
