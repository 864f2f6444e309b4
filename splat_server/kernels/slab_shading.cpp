#include "slab_shading.h"

#include <algorithm>
#include <cmath>

namespace volsplat {

namespace {

constexpr int kOpac = 2, kModu = 3;
constexpr double kMostOpaque = 1 - 1.0 / 4096;  // of a reference spacing: its depth is finite

double depth_of(double opacity) { return -std::log1p(-std::min(opacity, kMostOpaque)); }

double greatest_of(const double (&entries)[kTableEntries]) {
    return *std::max_element(entries, entries + kTableEntries);
}

bool constant(const double (&entries)[kTableEntries]) {
    return std::equal(entries + 1, entries + kTableEntries, entries);
}

}  // namespace

SlabShading::SlabShading(const SlabScene& scene, const SlabGrid& grid, const SlabRays& rays, const SlabLight& light)
    : scene_(scene), grid_(grid), rays_(rays), light_(light), depths_(new DepthIntegrals[1]) {
    // Whatever indexes what is the same everywhere, it may be density
    if (constant(scene_.opac)) scene_.cross_bar[kOpac] = Field::density;
    if (constant(scene_.modu)) scene_.cross_bar[kModu] = Field::density;
    const bool opac = by_density(kOpac), modu = by_density(kModu);
    const double others = (opac ? 1 : greatest_of(scene_.opac)) * (modu ? 1 : greatest_of(scene_.modu));
    double opacity[kTableEntries];
    next_visible_[kTableEntries] = kTableEntries;
    for (int n = kTableEntries - 1; n >= 0; --n) {
        opacity[n] = (opac ? scene_.opac[n] : 1) * (modu ? scene_.modu[n] : 1);
        next_visible_[n] = opacity[n] * others > 0 ? n : next_visible_[n + 1];
        if (next_visible_[n] == n) last_visible_ = std::max(last_visible_, n);
    }
    DepthIntegrals& depths = depths_[0];
    for (int level = 0; level < kOpacityLevels; ++level) {
        const double share = level / (kOpacityLevels - 1.0);
        depths[0][level] = 0;
        for (int n = 0; n < kTableEntries; ++n) depths[n + 1][level] = depths[n][level] + depth_of(opacity[n] * share);
    }
    for (int n = 0; n < kTableEntries; ++n) {
        const double depth = depth_of(opacity[n]);
        const ColourIntegral& before = colours_[n];
        ColourIntegral& after = colours_[n + 1];
        for (int channel = 0; channel < 3; ++channel) {
            after.emit[channel] = before.emit[channel] + depth * scene_.emit[n][channel];
            after.refl[channel] = before.refl[channel] + depth * scene_.refl[n][channel];
        }
        after.depth = before.depth + depth;
    }
}

SlabShadingView SlabShading::view() const {
    const int first = next_visible_[0];
    const bool together =
        std::all_of(next_visible_.begin() + std::min(first, kTableEntries), next_visible_.begin() + last_visible_ + 1,
                    [n = first](std::int32_t next) mutable { return next == n++; });
    return {&scene_,
            &grid_,
            &rays_,
            &light_,
            next_visible_.data(),
            first,
            last_visible_,
            first <= last_visible_ && together,
            by_density(kOpac) && by_density(kModu),
            depths_.get(),
            colours_.data()};
}

}  // namespace volsplat
