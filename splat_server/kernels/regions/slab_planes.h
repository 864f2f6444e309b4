// The planes of a region in a frame of slabs: voxels are added up on them, and each slab between two complete planes is
// shaded into the image, from the front to the back (protocol/rules/slab_shape.py).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/large_memory.h"
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
    int lead;                     // planes before plane 0 with which groups begin
    int before;                   // planes before that below a voxel's depth which it may reach
    int baseline;                 // pixels to either side that gradients look at
    double thickness;             // of a slab, in reference spacings
    Vector3 origin;               // grid coordinates of pixel (0, 0) on plane 0
    Vector3 right, down, behind;  // what a pixel and a plane add to them
    Vector3 low, high;            // within which slabs are drawn
};

class SlabPlanes {
public:
    SlabPlanes(const SlabFrame& frame, const SplatJob& job);

    // Voxels by rising groups. Returns how many were left out as hidden. Throws std::bad_alloc.
    std::uint64_t add(const SpanView* spans, std::size_t count);
    // Nothing comes any more: shades what is left.
    void finish();

private:
    // Of a part of a line on a plane.
    struct Densities {
        std::array<float, kTileColumns> density;
        std::array<bool, kTileColumns> known;
    };

    void make_room();
    std::uint64_t add_runs(const SpanView& span, std::uint64_t begin, std::uint64_t end, const unsigned char* packets);
    void shade_before(std::int64_t plane);
    void shade(std::int64_t slab);
    void shade_tile(std::int64_t slab, int row, int tile);
    void note_closed(int left, int right, int top, int bottom);
    void shade_pixel(std::int64_t slab, int x, int line, const float (&densities)[2], const bool (&known)[2]);
    bool clip(std::int64_t slab, int x, int y, double& from, double& to) const;
    Vector3 gradient(std::int64_t slab, int x, int line, const float (&densities)[2], const bool (&known)[2]) const;
    // Of a place on a plane, which may lie aside of the image; false where too little is known of it.
    bool density(std::int64_t plane, int x, int line, float& found) const;
    void densities(std::int64_t plane, int x, int count, int line, Densities& found) const;
    void clear(std::int64_t plane);
    std::uint8_t* touched(std::int64_t plane) const;
    std::int64_t place(std::int64_t plane, int x, int line) const;

    const SlabFrame frame_;
    const ImageView image_;
    const int row_begin_, row_end_;
    std::uint64_t* const work_;
    SlabSums sums_{};
    LargeArray<float> memory_;
    std::vector<std::uint8_t> touched_;
    std::int64_t next_slab_ = 0;
};

}  // namespace volsplat
