// Finds where the voxels of a group lie on the screen, and leaves out those that are hidden.
#include "closed_tiles.h"
#include "shaded_sample.h"
#include "splat_kernels.h"
#include "splat_server/kernels/slab_sums.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

class VoxelFinder {
public:
    VoxelFinder(const SlabTableView& table, const SlabSums& sums, const ImageView& image, SlabVoxels& found)
        : table_(table), sums_(sums), image_(image), closed_(image, kFrozenAlpha), found_(found) {}

    // Returns how many were left out as hidden.
    std::uint64_t find(const SlabRuns& runs) {
        const unsigned char* packets = runs.packets;
        for (std::uint64_t n = 0; n < runs.run_count; ++n) {
            const RowRun run = run_at(runs.runs, n);
            const unsigned char* const end = packets + std::uint64_t(run.count) * kPacketBytes;
            for (; packets != end; packets += kPacketBytes) take(packet_at(packets), run);
        }
        return hidden_;
    }

private:
    void take(std::uint64_t packet, const RowRun& run) {
        // To the nearest offset
        const int finer = kSubpixelBits - table_.offset_bits, offsets = 1 << table_.offset_bits;
        const std::int64_t half = finer ? std::int64_t{1} << (finer - 1) : 0;
        const std::int64_t x = (run.x0 + x_of(packet) + half) >> finer, y = (run.y0 + y_of(packet) + half) >> finer;
        const int depth = static_cast<int>(packet >> kDepthShift & kOpacityMask);
        if (depth >= kGroupPlanes << kDepthBits) return;  // no voxel's of this group
        const int phase = depth & ((1 << kDepthBits) - 1);
        const int fx = static_cast<int>(x & (offsets - 1)), fy = static_cast<int>(y & (offsets - 1));
        const std::int64_t left = (x >> table_.offset_bits) + table_.left[fx] + sums_.margin;
        const std::int64_t top = (y >> table_.offset_bits) + table_.top[fy] - sums_.first_line;
        if (left < 0 || left + table_.columns > sums_.columns || top >= sums_.lines || top + table_.rows <= 0) return;
        if (sums_.any_closed && hides(left - sums_.margin, top + sums_.first_line)) {
            ++hidden_;
            return;
        }
        ++found_.patches[patch_of(left, top, found_.patch_columns)];
        found_.voxels[found_.count++] = {
            static_cast<std::int32_t>(left),
            static_cast<std::int32_t>(top),
            static_cast<std::uint32_t>(fy * offsets + fx),
            static_cast<std::uint8_t>(phase),
            static_cast<std::uint8_t>((depth >> kDepthBits) + table_.before + table_.front[phase]),
            static_cast<std::uint8_t>(packet >> kDensityShift)};
    }

    // Whether all that a box, or gradients beside it, may change is closed.
    bool hides(std::int64_t left, std::int64_t top) const {
        const auto within = [](std::int64_t place, int size) {
            return static_cast<int>(place < 0 ? 0 : place < size ? place : size);
        };
        const int aside = sums_.aside;
        const PixelBox box{within(left - aside, image_.width), within(left + table_.columns + aside, image_.width),
                           within(top - aside, image_.height), within(top + table_.rows + aside, image_.height)};
        return box.x_begin >= box.x_end || box.y_begin >= box.y_end || closed_.hide(box);
    }

    const SlabTableView& table_;
    const SlabSums& sums_;
    const ImageView image_;
    const ClosedTiles closed_;
    SlabVoxels& found_;
    std::uint64_t hidden_ = 0;
};

}  // namespace

std::uint64_t find_slab_voxels(const SlabTableView& table, const SlabSums& sums, const ImageView& image,
                               const SlabRuns& runs, SlabVoxels& found) {
    return VoxelFinder(table, sums, image, found).find(runs);
}

}  // namespace volsplat::VOLSPLAT_PATH
