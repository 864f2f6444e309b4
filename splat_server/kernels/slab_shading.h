// How the densities of a slab become colour and opacity: after reconstruction, through the scene's tables and light
// (paper: "Shading"; integrated over the density from plane to plane after Engel et al. 2001). Here is what a frame
// prepares for it; paths/slab_colours.cpp does it.
//
// Opacity is that of a thickness of one reference spacing, so that a slab has the optical depth -log(1 - opacity) times
// its thickness. The tables are steps, an entry for the densities that round to it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/tables/patch_table.h"
#include "slab_samples.h"

namespace volsplat {

class SlabShading {
public:
    // What the light points to outlives it. A plane takes the place of the scene's tables; it is null where there is
    // none.
    SlabShading(const SlabScene& scene, const SlabGrid& grid, const SlabRays& rays, const SlabLight& light,
                const PatchTable* plane);

    SlabShadingView view() const;
    int baseline() const { return rays_.baseline; }

private:
    bool by_density(int table) const { return scene_.cross_bar[table] == Field::density; }
    void find_visible(const double (&opacity)[kTableEntries], double others);
    void take_tables();
    void take_plane(const PatchTable& plane);

    SlabScene scene_;
    const SlabGrid grid_;
    const SlabRays rays_;
    const SlabLight light_;
    std::array<std::int32_t, kTableEntries + 1> next_visible_;
    int last_visible_ = -1;
    const std::unique_ptr<DepthIntegrals[]> depths_;  // one
    std::vector<ColourIntegral> colours_;
};

}  // namespace volsplat
