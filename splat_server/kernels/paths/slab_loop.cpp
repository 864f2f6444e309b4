// Adds the slices of voxels' kernels to the planes of a frame of slabs. Sums of integers: no order matters.
#include "closed_tiles.h"
#include "shaded_sample.h"
#include "splat_kernels.h"
#include "splat_server/kernels/slab_sums.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

template <class Number>
class SlabLoop {
    typedef typename SumLayout<Number>::Weight Weight;
    typedef Number Numbers __attribute__((vector_size(kSliceLanes * sizeof(Number))));
    typedef Weight Weights __attribute__((vector_size(kSliceLanes * sizeof(Weight))));

public:
    SlabLoop(const SlabTableView& table, const SlabSums& sums, const ImageView& image)
        : table_(table), sums_(sums), image_(image), closed_(image) {}

    // Returns how many voxels were left out as hidden.
    std::uint64_t add(const SlabRuns& runs) {
        const unsigned char* packets = runs.packets;
        for (std::uint64_t n = 0; n < runs.run_count; ++n) {
            const RowRun run = run_at(runs.runs, n);
            const unsigned char* const end = packets + std::uint64_t(run.count) * kPacketBytes;
            for (; packets != end; packets += kPacketBytes) add(packet_at(packets), run, runs.first_plane);
        }
        return hidden_;
    }

private:
    void add(std::uint64_t packet, const RowRun& run, std::int64_t first_plane) {
        // To the nearest offset
        const int finer = kSubpixelBits - table_.offset_bits, offsets = 1 << table_.offset_bits;
        const std::int64_t half = finer ? std::int64_t{1} << (finer - 1) : 0;
        const std::int64_t x = (run.x0 + x_of(packet) + half) >> finer, y = (run.y0 + y_of(packet) + half) >> finer;
        const int depth = static_cast<int>(packet >> kDepthShift & kOpacityMask);
        if (depth >= kGroupPlanes << kDepthBits) return;  // no voxel's of this group
        const int phase = depth & ((1 << kDepthBits) - 1);
        const std::int64_t left = (x >> table_.offset_bits) - table_.left + sums_.margin;
        const std::int64_t top = (y >> table_.offset_bits) - table_.top - sums_.first_line;
        if (left < 0 || left + table_.pitch > sums_.pitch || top >= sums_.lines || top + table_.rows <= 0) return;
        if (sums_.any_closed && hides(left - sums_.margin, top + sums_.first_line)) {
            ++hidden_;
            return;
        }
        const std::int64_t slice = std::int64_t(table_.rows) * table_.pitch;
        const std::int64_t box = (phase * offsets + (y & (offsets - 1))) * offsets + (x & (offsets - 1));
        const Weight* const weights = static_cast<const Weight*>(table_.weights) + box * table_.slices * slice;
        const SliceSpan* const spans = table_.spans + phase * table_.slices;
        const Number one = Number{1} << SumLayout<Number>::kDensityBits | (packet >> kDensityShift & 255);
        const std::int64_t plane = first_plane + (depth >> kDepthBits) - table_.before;
        for (int m = 0; m < table_.slices; ++m) {
            if (plane + m < 0 || plane + m >= sums_.planes || spans[m].row_begin >= spans[m].row_end) continue;
            add(weights + m * slice, spans[m], one, static_cast<int>((plane + m) % sums_.ring), left, top);
        }
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

    void add(const Weight* weights, const SliceSpan& span, Number one, int plane, std::int64_t left,
             std::int64_t top) const {
        const std::int64_t begin = top + span.row_begin > 0 ? span.row_begin : -top;
        const std::int64_t end = top + span.row_end < sums_.lines ? span.row_end : sums_.lines - top;
        if (begin >= end) return;
        touch(plane, left + span.column_begin, left + span.column_end - 1, top + begin, top + end - 1);
        Number* line = static_cast<Number*>(sums_.sums) + plane * sums_.plane + (top + begin) * sums_.pitch + left;
        weights += begin * table_.pitch;
        for (std::int64_t row = begin; row < end; ++row, line += sums_.pitch, weights += table_.pitch)
            for (int x = span.column_begin; x < span.column_end; x += kSliceLanes) {
                Weights few;
                Numbers numbers;
                __builtin_memcpy(&few, weights + x, sizeof few);
                __builtin_memcpy(&numbers, line + x, sizeof numbers);
                numbers += __builtin_convertvector(few, Numbers) * one;
                __builtin_memcpy(line + x, &numbers, sizeof numbers);
            }
    }

    void touch(int plane, std::int64_t left, std::int64_t right, std::int64_t top, std::int64_t bottom) const {
        std::uint8_t* const tiles = sums_.touched + std::int64_t(plane) * sums_.tile_rows * sums_.tiles;
        for (std::int64_t row = top / kTileLines; row <= bottom / kTileLines; ++row)
            for (std::int64_t tile = left / kTileColumns; tile <= right / kTileColumns; ++tile)
                tiles[row * sums_.tiles + tile] = 1;
    }

    const SlabTableView& table_;
    const SlabSums& sums_;
    const ImageView image_;
    const ClosedTiles closed_;
    std::uint64_t hidden_ = 0;
};

}  // namespace

std::uint64_t splat_slabs(const SlabTableView& table, const SlabSums& sums, const ImageView& image,
                          const SlabRuns& runs) {
    return SlabLoop<std::uint32_t>(table, sums, image).add(runs);
}

std::uint64_t splat_wide_slabs(const SlabTableView& table, const SlabSums& sums, const ImageView& image,
                               const SlabRuns& runs) {
    return SlabLoop<std::uint64_t>(table, sums, image).add(runs);
}

}  // namespace volsplat::VOLSPLAT_PATH
