#include "slab_shading.h"

#include <algorithm>
#include <cmath>

namespace volsplat {

namespace {

constexpr int kEmit = 0, kRefl = 1, kOpac = 2, kModu = 3;
constexpr double kMostOpaque = 1 - 1.0 / 4096;  // of a reference spacing: its depth is finite

double depth_of(double opacity) { return -std::log1p(-std::min(opacity, kMostOpaque)); }

double greatest_of(const double (&entries)[kTableEntries]) {
    return *std::max_element(entries, entries + kTableEntries);
}

double greatest_of(const double (&entries)[kTableEntries][3]) {
    return *std::max_element(entries[0], entries[0] + 3 * kTableEntries);
}

}  // namespace

SlabShading::SlabShading(const SlabScene& scene, const SlabGrid& grid, const SlabRays& rays)
    : scene_(scene), grid_(grid), rays_(rays), depths_(new DepthIntegrals[1]) {
    const bool opac = by_density(kOpac), modu = by_density(kModu);
    const double others = (opac ? 1 : greatest_of(scene_.opac)) * (modu ? 1 : greatest_of(scene_.modu));
    double opacity[kTableEntries];
    next_visible_[kTableEntries] = kTableEntries;
    for (int n = kTableEntries - 1; n >= 0; --n) {
        opacity[n] = (opac ? scene_.opac[n] : 1) * (modu ? scene_.modu[n] : 1);
        next_visible_[n] = opacity[n] * others > 0 ? n : next_visible_[n + 1];
    }
    DepthIntegrals& depths = depths_[0];
    for (int level = 0; level < kOpacityLevels; ++level) {
        const double share = level / (kOpacityLevels - 1.0);
        depths[0][level] = 0;
        for (int n = 0; n < kTableEntries; ++n) depths[n + 1][level] = depths[n][level] + depth_of(opacity[n] * share);
    }
    for (int table : {kEmit, kRefl}) {
        const auto& entries = table == kEmit ? scene_.emit : scene_.refl;
        black_[table] = greatest_of(entries) == 0;
        for (int n = 0; n < kTableEntries; ++n) {
            const double depth = depth_of(opacity[n]), *const before = colours_[table][n];
            double* const after = colours_[table][n + 1];
            for (int channel = 0; channel < 3; ++channel)
                after[channel] = before[channel] + depth * entries[n][channel];
            after[3] = before[3] + depth;
        }
    }
}

SlabShadingView SlabShading::view() const {
    return {&scene_,       &grid_,
            &rays_,        next_visible_.data(),
            depths_.get(), {black_[kEmit] ? nullptr : &colours_[kEmit], black_[kRefl] ? nullptr : &colours_[kRefl]}};
}

}  // namespace volsplat
