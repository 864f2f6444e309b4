// Looks up opacities first, then the indices of the colour tables for what is left.
#include "row_shading.h"

#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "mapshade_server/kernels/shading_tables.h"

namespace volsplat {

namespace {

int axis_after(Field field, Field first) { return static_cast<int>(field) - static_cast<int>(first); }

}  // namespace

RowShading::RowShading(const WalkPlan& plan, const ShadingTables& tables, std::size_t longest_row)
    : kernels_(map_shade_kernels()), plan_(plan), tables_(tables), room_(longest_row + kSpare), codes_(room_) {}

SurvivingSamples RowShading::survivors(const SampleRow& row, const VisibleVoxels& voxels) {
    const bool all_opaque = look_up_opacity(row, voxels);
    const VisibleVoxels left = all_opaque ? voxels : without_transparent(voxels);
    return {left, codes_.data(), indices(tables_.emit, row, left, emit_), indices(tables_.refl, row, left, refl_)};
}

// Tells whether none of the voxels is transparent.
bool RowShading::look_up_opacity(const SampleRow& row, const VisibleVoxels& voxels) {
    const std::uint16_t* table = tables_.opacity[row.opacity];
    if (tables_.opac == Field::density && tables_.modu == Field::strength) {
        return kernels_.opacity_by_packet(voxels.packets, voxels.count, table, codes_.data());
    }
    return kernels_.opacity_by_indices(indices(tables_.opac, row, voxels, opac_),
                                       indices(tables_.modu, row, voxels, modu_), voxels.count, table, codes_.data());
}

VisibleVoxels RowShading::without_transparent(const VisibleVoxels& voxels) {
    positions_.resize(room_);
    packets_.resize(room_);
    std::size_t kept = 0;
    for (std::size_t s = 0; s < voxels.count; ++s) {
        positions_[kept] = voxels.positions[s];
        packets_[kept] = voxels.packets[s];
        codes_[kept] = codes_[s];
        kept += codes_[s] != 0;
    }
    return {positions_.data(), packets_.data(), kept};
}

TableIndices RowShading::indices(Field field, const SampleRow& row, const VisibleVoxels& voxels, Bytes& bytes) const {
    if (field == Field::density || field == Field::strength) {
        // Packets are little endian: density is the first byte, strength the second
        const std::uint8_t* first = reinterpret_cast<const std::uint8_t*>(voxels.packets);
        return {first + (field == Field::strength ? 1 : 0), sizeof(std::uint32_t)};
    }
    bytes.resize(room_);
    switch (field) {
        case Field::density:
        case Field::strength:
            break;
        case Field::gradient_i:
        case Field::gradient_j:
        case Field::gradient_k:
            kernels_.direction_bytes(voxels.packets, voxels.count,
                                     tables_.gradient_bytes + axis_after(field, Field::gradient_i) * kDirectionCodes,
                                     bytes.data());
            break;
        case Field::screen_x:
        case Field::screen_y:
        case Field::screen_z: {
            const Dda& dda = plan_.screen_index[axis_after(field, Field::screen_x)];
            kernels_.screen_bytes(voxels.positions, voxels.count, dda.at(row.doubled),
                                  2 * plan_.visits_of(2).stride * dda.half_steps[plan_.axes[2]], bytes.data());
            break;
        }
        case Field::grid_i:
        case Field::grid_j:
        case Field::grid_k: {
            const int axis = axis_after(field, Field::grid_i);
            const AxisVisits& visits = plan_.visits[axis];
            kernels_.grid_bytes(voxels.positions, voxels.count,
                                tables_.grid_bytes[axis] + visits.index(row.ordinals[axis]),
                                axis == plan_.axes[2] ? visits.stride : 0, bytes.data());
            break;
        }
    }
    return {bytes.data(), 1};
}

}  // namespace volsplat
