// Classifies and lights pixels of a slab, some at a time, step by step: the compiler makes vectors of each step's loop.
// The arithmetic is the same on every machine.
#include "few_powers.h"
#include "kernels/compiler.h"
#include "kernels/vectors.h"
#include "splat_kernels.h"
#include "splat_server/kernels/slab_samples.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr int kAtOnce = 64;
constexpr int kEmit = 0, kRefl = 1, kOpac = 2, kModu = 3;
constexpr float kNoGradient = 1e-9f;  // bytes per reference spacing
constexpr double kNoDepth = 1e-12;
constexpr double kParallel = 1e-12;
constexpr double kInside = 1e-6;    // voxels: beyond what rounding may add
constexpr float kThinnest = 1e-6f;  // part of a slab in which all is that shows
constexpr float kLeastOpacity = 1e-12f;
constexpr double kAboveTie = 0x1p-20;  // voxels: half-way between two the upper one is nearest
constexpr float kShallow = 0.5f;       // depth from which on the middle of what is seen needs no series
constexpr int kDepth = 3, kPlace = 3;

typedef double Reals[kAtOnce];
typedef float Floats[kAtOnce];

template <class Real>
inline Real least(Real a, Real b) {
    return b < a ? b : a;
}
template <class Real>
inline Real most(Real a, Real b) {
    return a < b ? b : a;
}
template <class Real>
inline Real within(Real value, Real low, Real high) {
    return least(most(value, low), high);
}

// The last of the entries before a place of 0 to 256.
inline std::int32_t entry_at(double place) { return static_cast<std::int32_t>(least(place, kTableEntries - 1.0)); }

typedef double TwoReals __attribute__((vector_size(16)));
typedef double FourReals __attribute__((vector_size(32)));

// Where the middle of what is seen lies in matter of an optical depth, of which `stopped` is stopped.
inline float middle_seen(float depth, float stopped) {
    const float series = 0.5f - depth / 12 + depth * depth * depth / 720;
    const float deep = 1 / most(depth, kShallow) - 1 / most(stopped, kShallow / 2) + 1;
    return depth < kShallow ? series : deep;
}

// At a place between entries, of which `of_entry` gives the address of some neighbouring numbers.
template <class Lanes, class OfEntry>
inline Lanes integral_to(double place, const OfEntry& of_entry) {
    const std::int32_t entry = entry_at(place);
    const Lanes before = load<Lanes>(of_entry(entry)), after = load<Lanes>(of_entry(entry + 1));
    return before + (place - entry) * (after - before);
}

class SlabColours {
public:
    SlabColours(const SlabShadingView& view, SlabSamples& samples)
        : view_(view), samples_(samples), lies_inside_(lies_inside()) {
        for (int axis = 0; axis < 3; ++axis)
            for (int n = 0; n < 3; ++n) to_physical_[axis][n] = static_cast<float>(view.grid->gradient[axis][n]);
    }

    void find() {
        for (first_ = 0; first_ < samples_.count; first_ += kAtOnce) {
            count_ = samples_.count - first_ < kAtOnce ? samples_.count - first_ : kAtOnce;
            reconstruct();
            clip();
            if (uses_gradient()) orient();
            span();
            integrate();
            make_opaque();
            colour();
        }
    }

private:
    bool by_density(int table) const { return view_.scene->cross_bar[table] == Field::density; }

    // Densities and differences on either plane where it is known, else those of the other one. Differences are
    // central; where a neighbour is not known, one-sided ones.
    void reconstruct() {
        const float *const front = samples_.here[0] + first_, *const back = samples_.here[1] + first_;
        const float *const in_front = samples_.next[0] + first_, *const behind = samples_.next[1] + first_;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const float from = front[n] > 0 ? front[n] : back[n], to = back[n] > 0 ? back[n] : front[n];
            const float least_known = least(front[n], back[n]), rise = to - from;
            from_[n] = from, to_[n] = to;
            differences_[0][2][n] = least(least_known, in_front[n]) > 0 ? (to - in_front[n]) / 2 : rise;
            differences_[1][2][n] = least(least_known, behind[n]) > 0 ? (behind[n] - from) / 2 : rise;
        }
        for (int axis = 0; axis < 2; ++axis) {
            Floats slopes[2];
            for (int side = 0; side < 2; ++side) find_slopes(side, axis, slopes[side]);
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) {
                differences_[0][axis][n] = front[n] > 0 ? slopes[0][n] : slopes[1][n];
                differences_[1][axis][n] = back[n] > 0 ? slopes[1][n] : slopes[0][n];
            }
        }
    }

    void find_slopes(int side, int axis, Floats& slopes) const {
        const auto aside = static_cast<float>(view_.rays->baseline);
        const float* const here = samples_.here[side] + first_;
        const float* const before = samples_.beside[side][2 * axis] + first_;
        const float* const behind = samples_.beside[side][2 * axis + 1] + first_;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const float low = before[n] > 0 ? before[n] : here[n], high = behind[n] > 0 ? behind[n] : here[n];
            const float sides = (before[n] > 0 ? 1.0f : 0.0f) + (behind[n] > 0 ? 1.0f : 0.0f);
            slopes[n] = (high - low) / (aside * most(sides, 1.0f));
        }
    }

    // Whether the bounds leave all of the slab at all samples.
    bool lies_inside() const {
        if (samples_.count == 0) return true;
        std::int32_t left = samples_.x[0], right = left, top = samples_.y[0], bottom = top;
        for (int n = 1; n < samples_.count; ++n) {
            left = least(left, samples_.x[n]), right = most(right, samples_.x[n]);
            top = least(top, samples_.y[n]), bottom = most(bottom, samples_.y[n]);
        }
        const SlabRays& rays = *view_.rays;
        bool inside = true;
        for (int axis = 0; axis < 3; ++axis) {
            const double front = rays.origin[axis] + static_cast<double>(samples_.slab) * rays.behind[axis];
            const double across[] = {left * rays.right[axis], right * rays.right[axis]};
            const double down[] = {top * rays.down[axis], bottom * rays.down[axis]};
            const double behind = rays.behind[axis];
            const double low = front + least(across[0], across[1]) + least(down[0], down[1]) + least(behind, 0.0);
            const double high = front + most(across[0], across[1]) + most(down[0], down[1]) + most(behind, 0.0);
            inside = inside && low >= rays.low[axis] + kInside && high <= rays.high[axis] - kInside;
        }
        return inside;
    }

    // The part of the slab within the bounds: its densities and differences, its thickness, and where its middle lies
    // on the grid.
    void clip() {
        const SlabRays& rays = *view_.rays;
        if (lies_inside_) {
            for (int n = 0; n < count_; ++n) thickness_[n] = rays.thickness;
            if (uses_place()) find_places(nullptr, nullptr);
            return;
        }
        Reals begin, end;
        for (int n = 0; n < count_; ++n) begin[n] = 0, end[n] = 1;
        find_places(begin, end);
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            begin[n] = least(begin[n], 1.0), end[n] = most(begin[n], end[n]);
            thickness_[n] = (end[n] - begin[n]) * rays.thickness;
        }
        cut(begin, end, from_, to_);
        for (int axis = 0; axis < 3; ++axis) cut(begin, end, differences_[0][axis], differences_[1][axis]);
    }

    void cut(const Reals& begin, const Reals& end, Floats& front, Floats& back) const {
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double from = front[n], rise = back[n] - from;
            front[n] = static_cast<float>(from + begin[n] * rise);
            back[n] = static_cast<float>(from + end[n] * rise);
        }
    }

    bool uses_place() const {
        bool found = view_.scene->depth_cue > 0 || view_.light->lamp;
        for (int table = kEmit; table <= kModu; ++table)
            found = found || view_.scene->cross_bar[table] >= Field::screen_x;
        return found;
    }

    // Of the middle of what is left of the slab; what that is is found if it is asked for.
    void find_places(double* begin, double* end) {
        const SlabRays& rays = *view_.rays;
        const std::int32_t *const x = samples_.x + first_, *const y = samples_.y + first_;
        for (int axis = 0; axis < 3; ++axis) {
            const double step = rays.behind[axis],
                         front = rays.origin[axis] + static_cast<double>(samples_.slab) * step;
            const double low = rays.low[axis], high = rays.high[axis];
            const double right = rays.right[axis], down = rays.down[axis];
            double* const place = place_[axis];
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) place[n] = front + x[n] * right + y[n] * down;
            if (!begin) continue;
            if (__builtin_fabs(step) < kParallel) {
                VOLSPLAT_INDEPENDENT
                for (int n = 0; n < count_; ++n) end[n] = place[n] < low || place[n] > high ? 0.0 : end[n];
                continue;
            }
            const double planes = 1 / step;
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) {
                const double one = (low - place[n]) * planes, other = (high - place[n]) * planes;
                begin[n] = most(begin[n], least(one, other));
                end[n] = least(end[n], most(one, other));
            }
        }
        for (int axis = 0; axis < 3; ++axis)
            for (int n = 0; n < count_; ++n) {
                const double middle = begin ? (begin[n] + most(begin[n], end[n])) / 2 : 0.5;
                place_[axis][n] += middle * rays.behind[axis];
            }
    }

    // Light is another's, which does not fall on the middle.
    bool uses_gradient() const {
        bool found = view_.by_strength || view_.scene->silhouettes > 0 || view_.light->lamp;
        for (const Field field : view_.scene->cross_bar)
            found = found || (field >= Field::strength && field <= Field::gradient_k);
        return found;
    }

    // Gradients in the middle of the slab, and their sizes.
    void orient() {
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const Vector found = gradient_at(n, 0.5f);
            gradient_[0][n] = found.x, gradient_[1][n] = found.y, gradient_[2][n] = found.z;
            size_[n] = found.size();
        }
    }

    struct Vector {
        float x, y, z;

        float size() const { return __builtin_sqrtf(x * x + y * y + z * z); }
        float along(const float (&other)[3]) const { return x * other[0] + y * other[1] + z * other[2]; }
    };

    // Along physical axes, so far through the slab, in which it changes evenly.
    Vector gradient_at(int n, float part) const {
        const float across = differences_[0][0][n] + part * (differences_[1][0][n] - differences_[0][0][n]);
        const float down = differences_[0][1][n] + part * (differences_[1][1][n] - differences_[0][1][n]);
        const float behind = differences_[0][2][n] + part * (differences_[1][2][n] - differences_[0][2][n]);
        const float (&matrix)[3][3] = to_physical_;
        return {matrix[0][0] * across + matrix[0][1] * down + matrix[0][2] * behind,
                matrix[1][0] * across + matrix[1][1] * down + matrix[1][2] * behind,
                matrix[2][0] * across + matrix[2][1] * down + matrix[2][2] * behind};
    }

    // Of densities, from that of entry 0 on: one entry wide at least.
    void span() {
        const double last = kTableEntries;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double from = from_[n], to = to_[n];
            const double middle = (from + to) / 2 + 0.5, half = most(__builtin_fabs(to - from) / 2, 0.5);
            low_[n] = within(middle - half, 0.0, last - 0.5);
            high_[n] = within(middle + half, 0.5, last);
        }
    }

    // Both colours times depth, depth, and places of entries times depth, over the span.
    void integrate() {
        if (!view_.by_strength) {
            integrate([this](int) { return view_.colours; });
            return;
        }
        std::int32_t strengths[kAtOnce];
        each(strengths, [this](int n) { return size_[n] * view_.grid->strength + 0.5; });
        integrate([&](int n) { return view_.colours + strengths[n] * (kTableEntries + 1); });
    }

    template <class OfSample>
    void integrate(const OfSample& of_sample) {
        for (int n = 0; n < count_; ++n) {
            const ColourIntegral* const colours = of_sample(n);
            const auto emitted = [&](std::int32_t entry) { return colours[entry].emit; };
            const auto reflected = [&](std::int32_t entry) { return colours[entry].refl; };
            store(emitted_[n], integral_to<FourReals>(high_[n], emitted) - integral_to<FourReals>(low_[n], emitted));
            store(reflected_[n],
                  integral_to<FourReals>(high_[n], reflected) - integral_to<FourReals>(low_[n], reflected));
        }
    }

    void make_opaque() {
        Reals through;
        if (view_.opaque_by_density) {
            for (int n = 0; n < count_; ++n) through[n] = emitted_[n][kDepth];
        } else {
            find_depths(through);
        }
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double depth = through[n] / (high_[n] - low_[n]) * thickness_[n];
            depth_[n] = static_cast<float>(depth);
            opacity_[n] = depth < kNoDepth ? 0.0f : stopped_by(depth_[n]);
        }
    }

    // By the opacity that is not density's.
    void find_depths(Reals& depths) const {
        Reals others;
        for (int n = 0; n < count_; ++n) others[n] = 1;
        for (int table = kOpac; table <= kModu; ++table) {
            if (by_density(table)) continue;
            const double* const entries = table == kOpac ? view_.scene->opac : view_.scene->modu;
            std::int32_t indices[kAtOnce];
            index(table, indices);
            for (int n = 0; n < count_; ++n) others[n] *= entries[indices[n]];
        }
        const DepthIntegrals& integrals = *view_.depths;
        for (int n = 0; n < count_; ++n) {
            const double place = (kOpacityLevels - 1) * (1 - __builtin_sqrt(1 - within(others[n], 0.0, 1.0)));
            const auto level = static_cast<std::int32_t>(least(place, kOpacityLevels - 2.0));
            const auto of_entry = [&](std::int32_t entry) { return integrals[entry] + level; };
            const TwoReals found = integral_to<TwoReals>(high_[n], of_entry) - integral_to<TwoReals>(low_[n], of_entry);
            depths[n] = found[0] + (place - level) * (found[1] - found[0]);
        }
    }

    // Of what density does not index the entry, else the mean over the span, by the depth that density alone gives.
    void colour() {
        Floats lit, left;
        light(lit);
        dim(left);
        if (view_.light->lamp) shade(lit, left);
        if (!by_density(kEmit)) take_entries(kEmit, view_.scene->emit, emitted_);
        if (!by_density(kRefl)) take_entries(kRefl, view_.scene->refl, reflected_);
        const bool of_emit = by_density(kEmit), of_refl = by_density(kRefl);
        const FourReals none{}, whole = none + 1.0;
        for (int n = 0; n < count_; ++n) {
            const double depth = emitted_[n][kDepth], share = depth < kNoDepth ? 0.0 : 1 / depth;
            const FourReals emitted = load<FourReals>(emitted_[n]) * (of_emit ? share : 1.0);
            const FourReals reflected = load<FourReals>(reflected_[n]) * (of_refl ? share : 1.0);
            const FourReals sum = (emitted + reflected * static_cast<double>(lit[n])) * static_cast<double>(left[n]);
            const FourReals above = sum < none ? none : sum, found = whole < above ? whole : above;
            float* const out = samples_.found[first_ + n];
            store(out, __builtin_convertvector(found, Four));
            out[kDepth] = opacity_[n];
        }
    }

    void take_entries(int table, const double (*entries)[3], double (*found)[4]) const {
        std::int32_t indices[kAtOnce];
        index(table, indices);
        for (int n = 0; n < count_; ++n)
            for (int channel = 0; channel < 3; ++channel) found[n][channel] = entries[indices[n]][channel];
    }

    // How far through the slab what is seen of it and lit has its middle, and its share of what is seen. What shows is
    // taken to be spread evenly around its middle. Light comes to one side only: where gradients turn through a slab,
    // to what lies in front of a place or behind it.
    void find_lit(const float (&lamp)[3], Floats& part, Floats& share) const {
        float towards[3];  // the lamp, of differences
        for (int n = 0; n < 3; ++n)
            towards[n] = to_physical_[0][n] * lamp[0] + to_physical_[1][n] * lamp[1] + to_physical_[2][n] * lamp[2];
        Floats middles, front, back;
        find_middles(middles);
        for (int side = 0; side < 2; ++side) {
            float* const facing = side == 0 ? front : back;
            const float *const across = differences_[side][0], *const down = differences_[side][1];
            const float* const behind = differences_[side][2];
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n)
                facing[n] = -(across[n] * towards[0] + down[n] * towards[1] + behind[n] * towards[2]);
        }
        const float turning = view_.scene->two_sided ? -__builtin_inff() : 0.0f;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const float half = most(least(middles[n], 1 - middles[n]), kThinnest / 2);
            const float width = 2 * half, begin = middles[n] - half;
            const float per_part = depth_[n] / width;
            const bool turns = front[n] * back[n] < turning, faces_front = front[n] > 0;
            const float apart = turns ? front[n] - back[n] : 1.0f;
            const float turn = within(front[n] / apart - begin, 0.0f, width);
            const float first = turns & !faces_front ? turn : 0.0f, last = turns & faces_front ? turn : width;
            const float seen_before = stopped_by(turn * per_part) / most(opacity_[n], kLeastOpacity);
            const float lit_depth = (last - first) * per_part;
            part[n] = begin + first + (last - first) * middle_seen(lit_depth, stopped_by(lit_depth));
            const float turned = faces_front ? seen_before : 1 - seen_before;
            share[n] = turns ? turned : 1.0f;
        }
    }

    // How far through the slab what shows of it has its middle.
    void find_middles(Floats& middles) const {
        for (int n = 0; n < count_; ++n) {
            const double depth = emitted_[n][kDepth], places = reflected_[n][kPlace];
            const double place = (places / most(depth, kNoDepth) - low_[n]) / (high_[n] - low_[n]);
            const double risen = depth < kNoDepth ? 0.5 : within(place, 0.0, 1.0);
            middles[n] = static_cast<float>(to_[n] < from_[n] ? 1 - risen : risen);
        }
    }

    // What multiplies the reflected colour. A gradient points to rising density: outwards is its opposite.
    void light(Floats& lit) const {
        const SlabScene& scene = *view_.scene;
        float lamp[3], half_way[3];
        for (int axis = 0; axis < 3; ++axis) {
            lamp[axis] = static_cast<float>(scene.light[axis]);
            half_way[axis] = static_cast<float>(scene.half_way[axis]);
        }
        Floats half, part, share, sizes;
        find_lit(lamp, part, share);
        const float diffuse = scene.diffuse ? 1 : 0, power = static_cast<float>(scene.specular_power);
        const bool two_sided = scene.two_sided;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const Vector gradient = gradient_at(n, part[n]);
            sizes[n] = gradient.size();
            const float outwards = -1 / most(sizes[n], kNoGradient);
            const float lambert = gradient.along(lamp) * outwards;
            const float towards_half = gradient.along(half_way) * outwards;
            const float shown = two_sided ? __builtin_fabsf(lambert) : lambert;
            half[n] = shown > 0 ? (two_sided ? __builtin_fabsf(towards_half) : towards_half) : 0.0f;
            lit[n] = diffuse * most(shown, 0.0f);
        }
        if (scene.specular) {
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) lit[n] += highlight(half[n], power);
        }
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) lit[n] = sizes[n] < kNoGradient ? 0.0f : share[n] * lit[n];
    }

    // What is left of all colour far from the viewer, and where a surface turns away from him.
    void dim(Floats& left) const {
        for (int n = 0; n < count_; ++n) left[n] = 1;
        if (view_.scene->depth_cue > 0) {
            const double cue = view_.scene->depth_cue;
            const auto& z = view_.grid->screen_bytes[2];
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) {
                const double byte = z[0] + z[1] * place_[0][n] + z[2] * place_[1][n] + z[3] * place_[2][n];
                left[n] *= static_cast<float>(1 - cue * (1 - within(byte / kTableEntries, 0.0, 1.0)));
            }
        }
        if (view_.scene->silhouettes > 0) {
            const auto strength = static_cast<float>(view_.scene->silhouettes);
            float behind[3], squared = 0;
            for (int axis = 0; axis < 3; ++axis) {
                behind[axis] = static_cast<float>(view_.grid->gradient[axis][2]);
                squared += behind[axis] * behind[axis];
            }
            const float unit = 1 / __builtin_sqrtf(most(squared, kNoGradient * kNoGradient));
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) {
                const float along =
                    gradient_[0][n] * behind[0] + gradient_[1][n] * behind[1] + gradient_[2][n] * behind[2];
                const float facing = __builtin_fabsf(along) * unit / most(size_[n], kNoGradient);
                const float aside = most(1 - facing, 0.0f);
                left[n] *= size_[n] < kNoGradient ? 1.0f : 1 - strength * aside * aside;
            }
        }
    }

    // What the volume leaves of light, and where it surrounds a place. Looked at a block outwards, so that a surface
    // does not shade itself.
    void shade(Floats& lit, Floats& left) const {
        const SlabLight& light = *view_.light;
        const auto shadows = static_cast<float>(light.shadows), occlusion = static_cast<float>(light.occlusion);
        for (int n = 0; n < count_; ++n) {
            double outwards[3], squared = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const double (&row)[3] = light.to_blocks[axis];
                outwards[axis] = -(row[0] * gradient_[0][n] + row[1] * gradient_[1][n] + row[2] * gradient_[2][n]);
                squared += outwards[axis] * outwards[axis];
            }
            const double unit = size_[n] < kNoGradient ? 0.0 : 1 / most(__builtin_sqrt(squared), 1e-300);
            std::int64_t low[3], high[3];
            float part[3];
            for (int axis = 0; axis < 3; ++axis) {
                const double last = light.dims[axis] - 1;
                const double block = (place_[axis][n] + 0.5) / light.size[axis] - 0.5 + outwards[axis] * unit;
                const double at = block > 0 ? least(block, last) : 0.0;  // also for what is no number
                low[axis] = static_cast<std::int64_t>(at);
                high[axis] = least(low[axis] + 1, static_cast<std::int64_t>(light.dims[axis] - 1));
                part[axis] = static_cast<float>(at - static_cast<double>(low[axis]));
            }
            const auto between = [&](const float* shares) {
                const auto along = [&](std::int64_t j, std::int64_t k) {
                    const float* const row = shares + (k * light.dims[1] + j) * light.dims[0];
                    return row[low[0]] + part[0] * (row[high[0]] - row[low[0]]);
                };
                const auto across = [&](std::int64_t k) {
                    const float before = along(low[1], k);
                    return before + part[1] * (along(high[1], k) - before);
                };
                const float before = across(low[2]);
                return before + part[2] * (across(high[2]) - before);
            };
            lit[n] *= 1 - shadows * (1 - between(light.lamp));
            // On a plane half the sky is open
            left[n] *= 1 - occlusion * (1 - least(2 * between(light.sky), 1.0f));
        }
    }

    // The byte of the field that indexes a table.
    void index(int table, std::int32_t (&found)[kAtOnce]) const {
        const Field field = view_.scene->cross_bar[table];
        if (field == Field::density) {
            each(found, [&](int n) { return (static_cast<double>(from_[n]) + to_[n]) / 2 + 0.5; });
        } else if (field == Field::strength) {
            each(found, [&](int n) { return size_[n] * view_.grid->strength + 0.5; });
        } else if (field <= Field::gradient_k) {
            const auto& axis = view_.grid->axes[static_cast<int>(field) - static_cast<int>(Field::gradient_i)];
            each(found, [&](int n) {
                const double along = gradient_[0][n] * axis[0] + gradient_[1][n] * axis[1] + gradient_[2][n] * axis[2];
                return 128.5 + (size_[n] < kNoGradient ? 0 : 127 * along / size_[n]);
            });
        } else if (field <= Field::screen_z) {
            const auto& screen = view_.grid->screen_bytes[static_cast<int>(field) - static_cast<int>(Field::screen_x)];
            each(found, [&](int n) {
                return screen[0] + (screen[1] * place_[0][n] + screen[2] * place_[1][n] + screen[3] * place_[2][n]);
            });
        } else {
            find_grid_bytes(static_cast<int>(field) - static_cast<int>(Field::grid_i), found);
        }
    }

    // Also for what is no number.
    template <class Value>
    void each(std::int32_t (&found)[kAtOnce], const Value& value) const {
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double byte = value(n);
            found[n] = static_cast<std::int32_t>(byte > 0 ? least(byte, 255.0) : 0.0);
        }
    }

    void find_grid_bytes(int axis, std::int32_t (&found)[kAtOnce]) const {
        const std::int64_t dim = view_.grid->dims[axis], factor = view_.grid->factors[axis];
        for (int n = 0; n < count_; ++n) {
            const double nearest = within(place_[axis][n], 0.0, static_cast<double>(dim)) + 0.5 + kAboveTie;
            const auto voxel = static_cast<std::int64_t>(nearest);
            const std::int64_t middle = voxel * factor + factor / 2;
            found[n] = static_cast<std::int32_t>(256 * (middle < dim ? middle : dim - 1) / dim);
        }
    }

    const SlabShadingView& view_;
    SlabSamples& samples_;
    int first_ = 0, count_ = 0;
    const bool lies_inside_;
    Floats from_, to_;          // densities at the two ends
    Floats differences_[2][3];  // per pixel right, pixel down and plane, likewise
    float to_physical_[3][3];
    Floats gradient_[3], size_;
    Reals place_[3], thickness_;
    Reals low_, high_;
    // Behind the colour of what is emitted, the depth; behind that of what is reflected, places times depth
    double emitted_[kAtOnce][4], reflected_[kAtOnce][4];
    Floats depth_, opacity_;
};

}  // namespace

void find_slab_colours(const SlabShadingView& view, SlabSamples& samples) { SlabColours(view, samples).find(); }

}  // namespace volsplat::VOLSPLAT_PATH
