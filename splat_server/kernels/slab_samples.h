// What slabs are shaded by, and pixels of them, as plain structs that the loops of every instruction set share
// (slab_shading.h).
#pragma once

#include <cstdint>

#include "kernels/field.h"
#include "kernels/tables/patch_table.h"
#include "slab_sums.h"

namespace volsplat {

// Of the opacity that fields other than density give, the finer the nearer it is to 1, where depth is steep: level n of
// N is 1 - (1 - n / (N - 1))^2.
constexpr int kOpacityLevels = 256;

struct SlabScene {
    Field cross_bar[4];  // of emit, refl, opac and modu
    double emit[kTableEntries][3], refl[kTableEntries][3];
    double opac[kTableEntries], modu[kTableEntries];
    double light[3], half_way[3];  // physical axes
    bool diffuse, specular, two_sided;
    double specular_power;
    double depth_cue, silhouettes;
};

struct SlabGrid {
    double gradient[3][3];      // from differences per pixel right, pixel down and plane to those along physical axes
    double axes[3][3];          // unit vectors along i, j and k
    double strength;            // bytes per unit of a physical gradient of densities
    double screen_bytes[3][4];  // of the fields screen x, y, z: at the grid's origin, and along i, j, k
    std::int64_t dims[3], factors[3];  // voxels of the volume, and those that one of the level stands for
};

struct SlabRays {
    double origin[3];                     // grid coordinates of pixel (0, 0) on plane 0
    double right[3], down[3], behind[3];  // what a pixel and a plane add to them
    double low[3], high[3];               // within which slabs are drawn
    double thickness;                     // of a slab, in reference spacings
    int baseline;                         // pixels to either side that gradients look at
};

// What light comes to blocks of voxels: (k, j, i), of the scene's light and from all sides.
struct SlabLight {
    const float *lamp, *sky;  // null: nothing is dimmed
    std::int32_t dims[3];     // blocks
    double size[3];           // voxels of a block
    double to_blocks[3][3];   // from physical vectors
    double shadows, occlusion;
};

// Integrals over tables, from entry 0 to before each: of the depth that density alone gives, and of that times red,
// green and blue of both colours and times where the middle of its entry lies; and of the depth at levels of the
// opacity that density lacks.
struct ColourIntegral {
    double emit[3], depth, refl[3], place;
};
typedef double DepthIntegrals[kTableEntries + 1][kOpacityLevels];

struct SlabShadingView {
    const SlabScene* scene;
    const SlabGrid* grid;
    const SlabRays* rays;
    const SlabLight* light;
    const std::int32_t* next_visible;  // [257]: the first entry from each on that can be seen
    int first_visible, last_visible;   // entries; all between can be seen if `visible_together`
    bool visible_together;
    bool opaque_by_density;  // and by nothing else
    const DepthIntegrals* depths;
    const ColourIntegral* colours;  // [257], or so many for each strength
    bool by_strength;
};

// Slabs are shaded once the plane behind them is complete, and look at the one in front of them, too: so many planes
// before a block are kept.
constexpr int kKeptPlanes = 3;

// Of the planes of a block at neighbouring pixels, and of those before it.
struct SlabDensities {
    const float* kept;    // kKeptPlanes of each pixel, one pixel after the other
    const float* planes;  // kBlockPlanes of the first pixel, before which two numbers may be read
    std::int64_t right;   // numbers from there to those of the next pixel
};

// Some pixels of one slab. A density of 0 is not known; those that are known lie above it.
struct SlabSamples {
    int count;
    std::int64_t slab;
    std::int32_t x[kTilePixels], y[kTilePixels];
    float here[2][kTilePixels];       // densities on its two planes
    float next[2][kTilePixels];       // on the plane in front of the first, and on that behind the second
    float beside[2][4][kTilePixels];  // left, right, above and below, as far as gradients look
    float found[kTilePixels][4];      // what comes of it: red, green, blue, and opacity
};

}  // namespace volsplat
