// Adds the slices of voxels' kernels to the planes of a frame of slabs. Sums of integers: no order matters.
//
// All planes of a block that a voxel reaches at a pixel are added to at once. So what is written is always read again
// as it was written, which is what lets the voxels of a row, whose boxes overlap, follow each other without waiting.
#include "kernels/vectors.h"
#include "splat_kernels.h"
#include "splat_server/kernels/slab_sums.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

template <class Number>
class SlabLoop {
    typedef typename SumLayout<Number>::Weight Weight;
    typedef Number Numbers __attribute__((vector_size(kBlockPlanes * sizeof(Number))));
    typedef Weight Weights __attribute__((vector_size(kBlockPlanes * sizeof(Weight))));

public:
    SlabLoop(const SlabTableView& table, const SlabSums& sums, std::int64_t group)
        : table_(table),
          sums_(sums),
          first_slot_(static_cast<int>(group % sums.slots)),
          column_(sums.slots * kBlockPlanes) {}

    void add(const SlabVoxel* voxels, std::uint64_t count) const {
        for (const SlabVoxel* voxel = voxels; voxel != voxels + count; ++voxel) add(*voxel);
    }

private:
    struct Box {
        std::int64_t left, top;  // of the sums
        const Weight* weights;
        const RowSpan* spans;
        int begin, end;  // rows
    };

    void add(const SlabVoxel& voxel) const {
        const std::int64_t offset = (std::int64_t(voxel.phase) << 2 * table_.offset_bits) + voxel.offset;
        const std::int64_t numbers = std::int64_t(table_.rows) * table_.columns * table_.slices;
        const int plane = voxel.plane, lines_left = sums_.lines - voxel.top;
        const Box box{voxel.left,
                      voxel.top,
                      static_cast<const Weight*>(table_.weights) + offset * numbers - plane,
                      table_.spans + (offset >> table_.offset_bits) * table_.rows,
                      voxel.top < 0 ? -voxel.top : 0,
                      table_.rows < lines_left ? table_.rows : lines_left};
        const Number one = Number{1} << SumLayout<Number>::kDensityBits | voxel.density;
        const int first = plane / kBlockPlanes, end = (plane + table_.slices - 1) / kBlockPlanes + 1;  // blocks
        touch(box, first, end);
#if defined(__AVX512F__)
        if constexpr (sizeof(Number) == 4)
            if (sums_.slots == 2) {
                if (first_slot_ == 0) add_both<false>(box, plane, one);
                else add_both<true>(box, plane, one);
                return;
            }
#endif
        for (int block = first; block < end; block += 2) add(box, plane, block, end - block, one);
    }

    // To this block and, if there is one, the next. `plane` is that of the first slice, counted from the first block.
    void add(const Box& box, int plane, int block, int blocks, Number one) const {
        const Numbers near = one & reached(plane, block), far = one & reached(plane, block + 1);
        Number* const sums = static_cast<Number*>(sums_.sums);
        const std::int64_t to_far = (slot(block + 1) - slot(block)) * kBlockPlanes;
        for (int row = box.begin; row < box.end; ++row) {
            const RowSpan span = box.spans[row];
            Number* pixel =
                sums + ((box.top + row) * sums_.pitch + box.left + span.begin) * column_ + slot(block) * kBlockPlanes;
            const Weight* weights =
                box.weights + (std::int64_t(row) * table_.columns + span.begin) * table_.slices + block * kBlockPlanes;
            if (blocks == 1) {
                for (int x = span.begin; x < span.end; ++x, pixel += column_, weights += table_.slices)
                    add(pixel, weights, near);
            } else {
                for (int x = span.begin; x < span.end; ++x, pixel += column_, weights += table_.slices) {
                    add(pixel, weights, near);
                    add(pixel + to_far, weights + kBlockPlanes, far);
                }
            }
        }
    }

#if defined(__AVX512F__)
    // To the two blocks that there are, which lie next to each other.
    template <bool swapped>
    void add_both(const Box& box, int plane, Number one) const {
        SixteenWords each = load<SixteenWords>(static_cast<const Number*>(table_.slice_bits) - plane);
        if (swapped) each = halves_swapped(each);
        each &= one;
        // What is stored might be these, as far as the compiler knows
        const std::int64_t slices = table_.slices, columns = table_.columns, line = sums_.pitch * 2 * kBlockPlanes;
        const Weight* const all_weights = box.weights;
        const RowSpan* const spans = box.spans;
        Number* pixel = static_cast<Number*>(sums_.sums) + (box.top + box.begin) * line + box.left * 2 * kBlockPlanes;
        for (int row = box.begin, end = box.end; row < end; ++row, pixel += line) {
            const RowSpan span = spans[row];
            const Weight* weights = all_weights + (row * columns + span.begin) * slices;
            Number* at = pixel + span.begin * 2 * kBlockPlanes;
            for (int left = span.end - span.begin; left > 0; --left, at += 2 * kBlockPlanes, weights += slices) {
                const SixteenWords few = sixteen_widened(weights);
                store(at, load<SixteenWords>(at) + (swapped ? halves_swapped(few) : few) * each);
            }
        }
    }
#endif

    // Beside the slices of the pixel those of its neighbours are read, and left out.
    static void add(Number* planes, const Weight* weights, const Numbers& each) {
        if constexpr (sizeof(Number) == 4) store(planes, load<Numbers>(planes) + eight_widened(weights) * each);
        else store(planes, load<Numbers>(planes) + __builtin_convertvector(load<Weights>(weights), Numbers) * each);
    }

    // All bits of the planes of a block that a slice lies on; `plane` is that of the first.
    Numbers reached(int plane, int block) const {
        return load<Numbers>(static_cast<const Number*>(table_.slice_bits) + block * kBlockPlanes - plane);
    }

    int slot(int block) const {
        const int found = first_slot_ + block;
        return found < sums_.slots ? found : found - sums_.slots;
    }

    void touch(const Box& box, int begin, int end) const {
        const std::int64_t right = box.left + table_.columns - 1;
        const std::int64_t first = (box.top + box.begin) / kTileLines, last = (box.top + box.end - 1) / kTileLines;
        for (int block = begin; block < end; ++block) {
            std::uint8_t* const tiles = sums_.touched + std::int64_t(slot(block)) * sums_.tile_rows * sums_.tiles;
            for (std::int64_t row = first; row <= last; ++row)
                for (std::int64_t tile = box.left / kTileColumns; tile <= right / kTileColumns; ++tile)
                    tiles[row * sums_.tiles + tile] = 1;
        }
    }

    const SlabTableView& table_;
    const SlabSums& sums_;
    const int first_slot_;
    const std::int64_t column_;  // numbers
};

}  // namespace

void splat_slabs(const SlabTableView& table, const SlabSums& sums, std::int64_t group, const SlabVoxel* voxels,
                 std::uint64_t count) {
    SlabLoop<std::uint32_t>(table, sums, group).add(voxels, count);
}

void splat_wide_slabs(const SlabTableView& table, const SlabSums& sums, std::int64_t group, const SlabVoxel* voxels,
                      std::uint64_t count) {
    SlabLoop<std::uint64_t>(table, sums, group).add(voxels, count);
}

}  // namespace volsplat::VOLSPLAT_PATH
