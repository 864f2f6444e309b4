#include "slab_shading.h"

#include <algorithm>
#include <cmath>

namespace volsplat {

namespace {

constexpr int kEmit = 0, kRefl = 1, kOpac = 2, kModu = 3;
constexpr int kOpacityLevels = 256;             // of what is not indexed by density
constexpr double kMostOpaque = 1 - 1.0 / 4096;  // of a reference spacing: its depth is finite
constexpr double kNoGradient = 1e-9;            // bytes per reference spacing
constexpr double kNoDepth = 1e-12;

double dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

double depth_of(double opacity) { return -std::log1p(-std::min(opacity, kMostOpaque)); }

// 0 also for what is no number.
int byte_of(double value) { return value > 0 ? static_cast<int>(std::min(value, 255.0)) : 0; }

int number(Field field) { return static_cast<int>(field); }

}  // namespace

SlabShading::SlabShading(const SlabScene& scene, const SlabGrid& grid) : scene_(scene), grid_(grid), colours_{} {
    const bool opac = by_density(kOpac), modu = by_density(kModu);
    const auto visible = [](const ScalarEntries& entries) { return *std::max_element(entries.begin(), entries.end()); };
    const double others = (opac ? 1 : visible(scene.opac)) * (modu ? 1 : visible(scene.modu));
    ScalarEntries opacity;
    next_visible_[kTableEntries] = kTableEntries;
    for (int n = kTableEntries - 1; n >= 0; --n) {
        opacity[n] = (opac ? scene.opac[n] : 1) * (modu ? scene.modu[n] : 1);
        next_visible_[n] = opacity[n] * others > 0 ? n : next_visible_[n + 1];
    }
    const int levels = opac && modu ? 1 : kOpacityLevels;
    depths_.resize(levels);
    for (int level = 0; level < levels; ++level) {
        const double share = levels == 1 ? 1 : level / (kOpacityLevels - 1.0);
        depths_[level][0] = 0;
        for (int n = 0; n < kTableEntries; ++n)
            depths_[level][n + 1] = depths_[level][n] + depth_of(opacity[n] * share);
    }
    for (int table : {kEmit, kRefl})
        for (int channel = 0; channel < 3; ++channel)
            for (int n = 0; n < kTableEntries; ++n) {
                const ColourEntries& entries = table == kEmit ? scene.emit : scene.refl;
                Integral& integral = colours_[table][channel];
                integral[n + 1] = integral[n] + depth_of(opacity[n]) * entries[n][channel];
            }
}

bool SlabShading::shows(float low, float high) const {
    // A slab's densities are taken to span one entry at least
    const int first = static_cast<int>(std::clamp(low, 0.0f, 255.0f)),
              last = static_cast<int>(std::min(high, 254.0f)) + 1;
    return next_visible_[first] <= last;
}

SlabShading::Span SlabShading::span_of(double from, double to) {
    const double middle = (from + to) / 2 + 0.5, half = std::max(std::abs(to - from) / 2, 0.5);
    const double last = kTableEntries;
    return {std::clamp(middle - half, 0.0, last - 0.5), std::clamp(middle + half, 0.5, last)};
}

double SlabShading::between(const Integral& integral, const Span& span) {
    const auto at = [&](double place) {
        const int cell = std::min(static_cast<int>(place), kTableEntries - 1);
        return integral[cell] + (place - cell) * (integral[cell + 1] - integral[cell]);
    };
    return at(span.high) - at(span.low);
}

SlabColour SlabShading::shade(const SlabSample& sample) const {
    Vector3 gradient;
    for (int axis = 0; axis < 3; ++axis) gradient[axis] = dot(grid_.gradient[axis], sample.gradient);
    const double size = std::sqrt(dot(gradient, gradient));
    const auto byte = [&](int table) { return index(table, sample, gradient, size); };
    const Span span = span_of(sample.from, sample.to);
    double others = 1;
    if (!by_density(kOpac)) others *= scene_.opac[byte(kOpac)];
    if (!by_density(kModu)) others *= scene_.modu[byte(kModu)];
    const double through = depth(span, others) * sample.thickness;
    if (through < kNoDepth) return {{}, 0};
    const Vector3 emitted = colour(kEmit, span, byte(kEmit)), reflected = colour(kRefl, span, byte(kRefl));
    const double lit = light(gradient, size);
    SlabColour shaded{{}, -std::expm1(-through)};
    for (int channel = 0; channel < 3; ++channel)
        shaded.colour[channel] = std::clamp(emitted[channel] + reflected[channel] * lit, 0.0, 1.0);
    return shaded;
}

// For one reference spacing; `others` is the opacity of what is not indexed by density.
double SlabShading::depth(const Span& span, double others) const {
    const double width = span.high - span.low;
    if (depths_.size() == 1) return between(depths_[0], span) / width;
    const double place = std::clamp(others, 0.0, 1.0) * (kOpacityLevels - 1);
    const int level = std::min(static_cast<int>(place), kOpacityLevels - 2);
    const double low = between(depths_[level], span), high = between(depths_[level + 1], span);
    return (low + (place - level) * (high - low)) / width;
}

Vector3 SlabShading::colour(int table, const Span& span, int index) const {
    const ColourEntries& entries = table == kEmit ? scene_.emit : scene_.refl;
    if (!by_density(table)) return entries[index];
    const double all = between(depths_.back(), span);
    if (all < kNoDepth) return entries[index];
    Vector3 mean;
    for (int channel = 0; channel < 3; ++channel) mean[channel] = between(colours_[table][channel], span) / all;
    return mean;
}

// What multiplies the reflected colour. A gradient points to rising density: outwards is its opposite.
double SlabShading::light(const Vector3& gradient, double size) const {
    if (size < kNoGradient) return 0;
    double lambert = -dot(gradient, scene_.light) / size, half = -dot(gradient, scene_.half_way) / size;
    if (scene_.two_sided) lambert = std::abs(lambert), half = std::abs(half);
    double sum = scene_.diffuse ? std::max(lambert, 0.0) : 0;
    if (scene_.specular && lambert > 0 && half > 0) sum += std::pow(half, scene_.specular_power);
    return sum;
}

// The byte of the field that indexes a table.
int SlabShading::index(int table, const SlabSample& sample, const Vector3& gradient, double size) const {
    const Field field = scene_.cross_bar[table];
    if (field == Field::density) return byte_of((sample.from + sample.to) / 2 + 0.5);
    if (field == Field::strength) return byte_of(std::min(size * grid_.strength, 255.0) + 0.5);
    if (field <= Field::gradient_k) {
        const Vector3& axis = grid_.axes[number(field) - number(Field::gradient_i)];
        return byte_of(128.5 + (size < kNoGradient ? 0 : 127 * dot(gradient, axis) / size));
    }
    if (field <= Field::screen_z) {
        const auto& screen = grid_.screen_bytes[number(field) - number(Field::screen_x)];
        return byte_of(screen[0] + dot({screen[1], screen[2], screen[3]}, sample.place));
    }
    const int axis = number(field) - number(Field::grid_i);
    const std::int64_t dim = grid_.dims[axis], factor = grid_.factors[axis];
    const double place = std::clamp(sample.place[axis], 0.0, static_cast<double>(dim));
    const auto voxel = static_cast<std::int64_t>(place + 0.5);
    return static_cast<int>(256 * std::clamp<std::int64_t>(voxel * factor + factor / 2, 0, dim - 1) / dim);
}

}  // namespace volsplat
