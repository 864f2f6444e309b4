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

// The integral up to behind entry n, given that before it.
template <class Channel>
ColourIntegral with_entry(const ColourIntegral& before, int n, double depth, const Channel* emit, const Channel* refl) {
    ColourIntegral after{};
    for (int channel = 0; channel < 3; ++channel) {
        after.emit[channel] = before.emit[channel] + depth * emit[channel];
        after.refl[channel] = before.refl[channel] + depth * refl[channel];
    }
    after.depth = before.depth + depth;
    after.place = before.place + depth * (n + 0.5);
    return after;
}

bool constant(const double (&entries)[kTableEntries]) {
    return std::equal(entries + 1, entries + kTableEntries, entries);
}

}  // namespace

SlabShading::SlabShading(const SlabScene& scene, const SlabGrid& grid, const SlabRays& rays, const SlabLight& light,
                         const PatchTable* plane)
    : scene_(scene), grid_(grid), rays_(rays), light_(light), depths_(new DepthIntegrals[1]) {
    if (plane) take_plane(*plane);
    else take_tables();
}

void SlabShading::take_tables() {
    // Whatever indexes what is the same everywhere, it may be density
    if (constant(scene_.opac)) scene_.cross_bar[kOpac] = Field::density;
    if (constant(scene_.modu)) scene_.cross_bar[kModu] = Field::density;
    const bool opac = by_density(kOpac), modu = by_density(kModu);
    const double others = (opac ? 1 : greatest_of(scene_.opac)) * (modu ? 1 : greatest_of(scene_.modu));
    double opacity[kTableEntries];
    for (int n = 0; n < kTableEntries; ++n) opacity[n] = (opac ? scene_.opac[n] : 1) * (modu ? scene_.modu[n] : 1);
    find_visible(opacity, others);
    DepthIntegrals& depths = depths_[0];
    for (int level = 0; level < kOpacityLevels; ++level) {
        const double from_opaque = 1 - level / (kOpacityLevels - 1.0), share = 1 - from_opaque * from_opaque;
        depths[0][level] = 0;
        for (int n = 0; n < kTableEntries; ++n) depths[n + 1][level] = depths[n][level] + depth_of(opacity[n] * share);
    }
    colours_.resize(kTableEntries + 1);
    for (int n = 0; n < kTableEntries; ++n) {
        colours_[n + 1] = with_entry(colours_[n], n, depth_of(opacity[n]), scene_.emit[n], scene_.refl[n]);
    }
}

void SlabShading::take_plane(const PatchTable& plane) {
    for (Field& field : scene_.cross_bar) field = Field::density;
    double greatest[kTableEntries]{};
    colours_.resize(kTableEntries * (kTableEntries + 1));
    for (int strength = 0; strength < kTableEntries; ++strength) {
        ColourIntegral* const row = &colours_[strength * (kTableEntries + 1)];
        for (int n = 0; n < kTableEntries; ++n) {
            const int at = strength * kTableEntries + n;
            greatest[n] = std::max(greatest[n], plane.opacity[at]);
            row[n + 1] = with_entry(row[n], n, depth_of(plane.opacity[at]), &plane.emit[4 * at], &plane.refl[4 * at]);
        }
    }
    find_visible(greatest, 1);
}

// The entries that can be seen, given the greatest opacity of what density does not index.
void SlabShading::find_visible(const double (&opacity)[kTableEntries], double others) {
    next_visible_[kTableEntries] = kTableEntries;
    for (int n = kTableEntries - 1; n >= 0; --n) {
        next_visible_[n] = opacity[n] * others > 0 ? n : next_visible_[n + 1];
        if (next_visible_[n] == n) last_visible_ = std::max(last_visible_, n);
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
            colours_.data(),
            colours_.size() > kTableEntries + 1};
}

}  // namespace volsplat
