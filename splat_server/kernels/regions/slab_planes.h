// The planes of a region in a frame of slabs: voxels are added up on them, and the slabs of each complete block of
// planes are shaded into the image, from the front to the back (protocol/rules/slab_shape.py).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/large_memory.h"
#include "slab_seconds.h"
#include "splat_server/kernels/slab_shading.h"
#include "splat_server/kernels/slab_sums.h"
#include "splat_server/kernels/slab_table.h"
#include "splat_server/kernels/splat_job.h"

namespace volsplat {

// A frame's numbers; what it points to outlives it.
struct SlabFrame {
    const SlabTable* table;
    const SlabShading* shading;
    int planes;
    int lead;  // planes before plane 0 with which the first block begins
};

class SlabPlanes {
public:
    SlabPlanes(const SlabFrame& frame, const SplatJob& job);

    // Voxels by rising groups. Returns how many were left out as hidden. Throws std::bad_alloc.
    std::uint64_t add(const SpanView* spans, std::size_t count);
    // Nothing comes any more: shades what is left, and gives its memory back.
    void finish();
    // So far.
    SlabSeconds seconds() const;

private:
    struct TileArea {
        int left, right;  // pixels
        int top, bottom;  // lines of the sums
    };

    // One of the planes that a slab looks at: its densities, and how far it is to those of the next pixels.
    struct Plane {
        const float* densities;
        std::int64_t right, down;
    };

    // For each slab of a block the pixels of a tile that show anything.
    struct ShownPixels {
        std::array<int, kBlockPlanes> counts;
        std::array<std::uint16_t, kTilePixels + 1> pixels[kBlockPlanes];
    };

    void make_room();
    void let_go();
    std::uint64_t add_runs(const SpanView& span, std::uint64_t begin, std::uint64_t end, const unsigned char* packets);
    void add_group();
    void touch(std::size_t patch);
    void shade_before(std::int64_t block);
    void shade(std::int64_t block);
    template <class Do>
    void each_tile(const std::uint8_t* marks, int row, const Do& act) const;
    void find_densities(int row, int tile);
    void shade_tile(std::int64_t block, int row, int tile);
    bool find_shown(std::int64_t block, const TileArea& area, ShownPixels& shown) const;
    void shade_slab(std::int64_t block, int slab, const TileArea& area, const ShownPixels& shown);
    void note_closed(const TileArea& area);
    void move_on(int row, int tile);
    template <class Number>
    void move_on(int row, int tile);
    TileArea area_of(int row, int tile) const;
    std::int64_t first_slab(std::int64_t block) const;
    Plane plane(int number) const;
    char* planes_at(int line, int column) const;

    const SlabFrame frame_;
    const ImageView image_;
    const int row_begin_, row_end_;
    std::uint64_t* const work_;
    const std::int64_t groups_;
    const std::size_t number_bytes_;
    SlabSums sums_{};
    LargeArray<float> memory_;
    std::vector<std::uint8_t> touched_;  // [block][tile row][tile]
    std::int64_t group_ = 0;             // of the voxels that are found
    std::vector<SlabVoxel> voxels_, sorted_;
    SlabVoxels found_{};
    std::vector<std::uint32_t> patches_;
    std::vector<float> kept_;  // [line][column][kKeptPlanes], of the last planes before the next block
    std::vector<std::uint8_t> last_touched_;
    std::int64_t next_block_ = 0;
    SlabSamples samples_;
    LapClock clock_;
    SlabSeconds seconds_;  // shading and compositing, which take turns, as one
    SampledClock tile_clock_;
    double shading_sampled_ = 0, compositing_sampled_ = 0;
};

}  // namespace volsplat
