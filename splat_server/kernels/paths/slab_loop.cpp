// Adds the slices of voxels' kernels to the planes of a frame of slabs. Sums of integers: no order matters.
//
// Eight planes are added to at once at a pixel, from a fourth one on: which are enough for the kernels of most frames,
// so that a pixel is loaded and stored once. Boxes of few columns are added whole, corners that are never reached
// included: to guess wrong where each row ends costs more than a dozen of pixels.
#include "kernels/vectors.h"
#include "splat_kernels.h"
#include "splat_server/kernels/slab_sums.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr int kMostWhole = 10;  // columns

template <class Number>
class SlabLoop {
    typedef typename SumLayout<Number>::Weight Weight;
    typedef Number Numbers __attribute__((vector_size(kPlanesAtOnce * sizeof(Number))));
    typedef Weight Weights __attribute__((vector_size(kPlanesAtOnce * sizeof(Weight))));

public:
    SlabLoop(const SlabTableView& table, const SlabSums& sums) : table_(table), sums_(sums) {}

    void add(const SlabVoxel* voxels, std::uint64_t count) const { add<kMostWhole>(voxels, count); }

private:
    struct Box {
        const Weight* weights;
        const RowSpan* spans;
        int rows;
        Number* pixels;  // of the first plane
    };

    // With as many columns as the table has; 0 is any number.
    template <int columns>
    void add(const SlabVoxel* voxels, std::uint64_t count) const {
        if (columns != 0 && table_.columns != columns) return add<columns == 0 ? 0 : columns - 1>(voxels, count);
        for (const SlabVoxel* voxel = voxels; voxel != voxels + count; ++voxel) add<columns>(*voxel);
    }

    template <int columns>
    void add(const SlabVoxel& voxel) const {
        const std::int64_t offset = (std::int64_t(voxel.phase) << 2 * table_.offset_bits) + voxel.offset;
        const std::int64_t line = std::int64_t(table_.columns) * table_.slices;
        const int begin = voxel.top < 0 ? -voxel.top : 0, lines_left = sums_.lines - voxel.top;
        const int end = table_.rows < lines_left ? table_.rows : lines_left;
        const int first = voxel.plane / kPlaneStep * kPlaneStep, ahead = voxel.plane - first;
        Box box{
            static_cast<const Weight*>(table_.weights) + (offset * table_.rows + begin) * line - ahead,
            table_.spans + (offset >> table_.offset_bits) * table_.rows + begin, end - begin,
            static_cast<Number*>(sums_.sums) + ((voxel.top + begin) * sums_.pitch + voxel.left) * sums_.planes + first};
        const Number one = Number{1} << SumLayout<Number>::kDensityBits | voxel.density;
        const Number* bits = static_cast<const Number*>(table_.slice_bits) - ahead;
        for (int left = ahead + table_.slices; left > 0; left -= kPlanesAtOnce) {
            add<columns>(box, one & load<Numbers>(bits));
            box.weights += kPlanesAtOnce, box.pixels += kPlanesAtOnce, bits += kPlanesAtOnce;
        }
    }

    // Beside the slices of a pixel those of its neighbours are read, and left out.
    template <int columns>
    void add(const Box& box, const Numbers each) const {
        // What is stored might be these, as far as the compiler knows
        const std::int64_t slices = table_.slices, planes = sums_.planes, to_next = sums_.pitch * planes;
        const std::int64_t line = table_.columns * slices;
        const Weight* weights = box.weights;
        Number* pixels = box.pixels;
        for (int row = 0, rows = box.rows; row < rows; ++row, weights += line, pixels += to_next) {
            if constexpr (columns != 0) {
                VOLSPLAT_UNROLL(16)
                for (int x = 0; x < columns; ++x) add(pixels + x * planes, weights + x * slices, each);
            } else {
                const RowSpan span = box.spans[row];
                Number* pixel = pixels + span.begin * planes;
                const Weight* few = weights + span.begin * slices;
                for (int left = span.end - span.begin; left > 0; --left, pixel += planes, few += slices)
                    add(pixel, few, each);
            }
        }
    }

    static void add(Number* planes, const Weight* weights, const Numbers& each) {
        if constexpr (sizeof(Number) == 4) store(planes, load<Numbers>(planes) + eight_widened(weights) * each);
        else store(planes, load<Numbers>(planes) + __builtin_convertvector(load<Weights>(weights), Numbers) * each);
    }

    const SlabTableView& table_;
    const SlabSums& sums_;
};

}  // namespace

void splat_slabs(const SlabTableView& table, const SlabSums& sums, const SlabVoxel* voxels, std::uint64_t count) {
    SlabLoop<std::uint32_t>(table, sums).add(voxels, count);
}

void splat_wide_slabs(const SlabTableView& table, const SlabSums& sums, const SlabVoxel* voxels, std::uint64_t count) {
    SlabLoop<std::uint64_t>(table, sums).add(voxels, count);
}

}  // namespace volsplat::VOLSPLAT_PATH
