// Classifies and lights pixels of a slab, some at a time, step by step: the compiler makes vectors of each step's loop.
// The arithmetic is the same on every machine.
#include "kernels/compiler.h"
#include "kernels/powers.h"
#include "kernels/vectors.h"
#include "splat_kernels.h"
#include "splat_server/kernels/slab_samples.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr int kAtOnce = 64;
constexpr int kEmit = 0, kRefl = 1, kOpac = 2, kModu = 3;
constexpr double kNoGradient = 1e-9;  // bytes per reference spacing
constexpr double kNoDepth = 1e-12;
constexpr double kParallel = 1e-12;
constexpr double kLog2E = 1.44269504088896340736;

typedef double Reals[kAtOnce];

inline double least(double a, double b) { return b < a ? b : a; }
inline double most(double a, double b) { return a < b ? b : a; }
inline double within(double value, double low, double high) { return least(most(value, low), high); }

// The last of the entries before a place of 0 to 256.
inline std::int32_t entry_at(double place) { return static_cast<std::int32_t>(least(place, kTableEntries - 1)); }

typedef double TwoReals __attribute__((vector_size(16)));
typedef double FourReals __attribute__((vector_size(32)));

// At a place between entries, of which `of_entry` gives the address of some neighbouring numbers.
template <class Lanes, class OfEntry>
inline Lanes integral_to(double place, const OfEntry& of_entry) {
    const std::int32_t entry = entry_at(place);
    const Lanes before = load<Lanes>(of_entry(entry)), after = load<Lanes>(of_entry(entry + 1));
    return before + (place - entry) * (after - before);
}

class SlabColours {
public:
    SlabColours(const SlabShadingView& view, SlabSamples& samples) : view_(view), samples_(samples) {}

    void find() {
        for (first_ = 0; first_ < samples_.count; first_ += kAtOnce) {
            count_ = samples_.count - first_ < kAtOnce ? samples_.count - first_ : kAtOnce;
            reconstruct();
            clip();
            orient();
            span();
            make_opaque();
            colour();
        }
    }

private:
    bool by_density(int table) const { return view_.scene->cross_bar[table] == Field::density; }

    // Densities where known, else those of the other plane, and central differences in the middle of the slab; where a
    // neighbour is not known, one-sided ones.
    void reconstruct() {
        const double aside = view_.rays->baseline;
        const float *const front = samples_.here[0] + first_, *const back = samples_.here[1] + first_;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            from_[n] = front[n] > 0 ? front[n] : back[n];
            to_[n] = back[n] > 0 ? back[n] : front[n];
            differences_[0][n] = differences_[1][n] = 0;
            differences_[2][n] = to_[n] - from_[n];
        }
        for (int side = 0; side < 2; ++side)
            for (int axis = 0; axis < 2; ++axis) {
                const float* const here = samples_.here[side] + first_;
                const float* const before = samples_.beside[side][2 * axis] + first_;
                const float* const behind = samples_.beside[side][2 * axis + 1] + first_;
                double* const differences = differences_[axis];
                VOLSPLAT_INDEPENDENT
                for (int n = 0; n < count_; ++n) {
                    const double low = before[n] > 0 ? before[n] : here[n], high = behind[n] > 0 ? behind[n] : here[n];
                    const double sides = (before[n] > 0 ? 1.0 : 0.0) + (behind[n] > 0 ? 1.0 : 0.0);
                    const double planes = (front[n] > 0 ? 1.0 : 0.0) + (back[n] > 0 ? 1.0 : 0.0);
                    const double slope = (high - low) / (aside * most(sides, 1.0) * most(planes, 1.0));
                    differences[n] += here[n] > 0 ? slope : 0.0;
                }
            }
    }

    // The part of the slab within the bounds: its densities, its thickness, and where its middle lies on the grid.
    void clip() {
        const SlabRays& rays = *view_.rays;
        const std::int32_t *const x = samples_.x + first_, *const y = samples_.y + first_;
        const double slab = static_cast<double>(samples_.slab);
        Reals begin, end;
        for (int n = 0; n < count_; ++n) begin[n] = 0, end[n] = 1;
        for (int axis = 0; axis < 3; ++axis) {
            const double step = rays.behind[axis], front = rays.origin[axis] + slab * step;
            const double low = rays.low[axis], high = rays.high[axis];
            const double right = rays.right[axis], down = rays.down[axis];
            double* const place = place_[axis];
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) place[n] = front + x[n] * right + y[n] * down;
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
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double from = from_[n], rise = to_[n] - from;
            const double last = most(begin[n], end[n]);
            thickness_[n] = (last - begin[n]) * rays.thickness;
            from_[n] = from + begin[n] * rise;
            to_[n] = from + last * rise;
            for (int axis = 0; axis < 3; ++axis) place_[axis][n] += (begin[n] + last) / 2 * rays.behind[axis];
        }
    }

    // Gradients along physical axes, and their sizes.
    void orient() {
        const auto& matrix = view_.grid->gradient;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double across = differences_[0][n], down = differences_[1][n], behind = differences_[2][n];
            double square = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const double component = matrix[axis][0] * across + matrix[axis][1] * down + matrix[axis][2] * behind;
                gradient_[axis][n] = component;
                square += component * component;
            }
            size_[n] = __builtin_sqrt(square);
        }
    }

    // Of densities, from that of entry 0 on: one entry wide at least.
    void span() {
        const double last = kTableEntries;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double middle = (from_[n] + to_[n]) / 2 + 0.5,
                         half = most(__builtin_fabs(to_[n] - from_[n]) / 2, 0.5);
            low_[n] = within(middle - half, 0.0, last - 0.5);
            high_[n] = within(middle + half, 0.5, last);
        }
    }

    void make_opaque() {
        Reals others;
        for (int n = 0; n < count_; ++n) others[n] = kOpacityLevels - 1;
        for (int table = kOpac; table <= kModu; ++table) {
            if (by_density(table)) continue;
            const double* const entries = table == kOpac ? view_.scene->opac : view_.scene->modu;
            std::int32_t indices[kAtOnce];
            index(table, indices);
            for (int n = 0; n < count_; ++n) others[n] *= entries[indices[n]];
        }
        const DepthIntegrals& integrals = *view_.depths;
        float* const opacity = samples_.opacity + first_;
        for (int n = 0; n < count_; ++n) {
            const double place = within(others[n], 0.0, kOpacityLevels - 1);
            const auto level = static_cast<std::int32_t>(least(place, kOpacityLevels - 2));
            const auto of_entry = [&](std::int32_t entry) { return integrals[entry] + level; };
            const TwoReals depths =
                integral_to<TwoReals>(high_[n], of_entry) - integral_to<TwoReals>(low_[n], of_entry);
            depth_[n] = depths[0] + (place - level) * (depths[1] - depths[0]);
        }
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double through = depth_[n] / (high_[n] - low_[n]) * thickness_[n];
            opacity[n] = static_cast<float>(through < kNoDepth ? 0.0 : 1 - exp2_exactly(-through * kLog2E));
        }
    }

    void colour() {
        Reals lit, emitted[3], reflected[3];
        light(lit);
        entries(kEmit, view_.scene->emit, emitted);
        entries(kRefl, view_.scene->refl, reflected);
        for (int channel = 0; channel < 3; ++channel) {
            float* const colour = samples_.colour[channel] + first_;
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n)
                colour[n] = static_cast<float>(within(emitted[channel][n] + reflected[channel][n] * lit[n], 0.0, 1.0));
        }
    }

    // Of a table that density indexes the mean over the span, by the depth that density alone gives.
    void entries(int table, const double (*entries)[3], Reals (&found)[3]) const {
        if (!view_.colours[table]) {
            for (int channel = 0; channel < 3; ++channel)
                for (int n = 0; n < count_; ++n) found[channel][n] = 0;
            return;
        }
        std::int32_t indices[kAtOnce];
        index(table, indices);
        for (int channel = 0; channel < 3; ++channel)
            for (int n = 0; n < count_; ++n) found[channel][n] = entries[indices[n]][channel];
        if (!by_density(table)) return;
        const ColourIntegral& integral = *view_.colours[table];
        const auto of_entry = [&](std::int32_t entry) { return integral[entry]; };
        for (int n = 0; n < count_; ++n) {
            const FourReals sum =
                integral_to<FourReals>(high_[n], of_entry) - integral_to<FourReals>(low_[n], of_entry);
            const double depth = sum[3];
            for (int channel = 0; channel < 3; ++channel)
                found[channel][n] = depth < kNoDepth ? found[channel][n] : sum[channel] / depth;
        }
    }

    // What multiplies the reflected colour. A gradient points to rising density: outwards is its opposite.
    void light(Reals& lit) const {
        const SlabScene& scene = *view_.scene;
        const auto &lamp = scene.light, &half_way = scene.half_way;
        Reals half;
        const double diffuse = scene.diffuse ? 1 : 0;
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) {
            const double size = most(size_[n], kNoGradient);
            const double x = -gradient_[0][n] / size, y = -gradient_[1][n] / size, z = -gradient_[2][n] / size;
            const double lambert = x * lamp[0] + y * lamp[1] + z * lamp[2];
            const double towards_half = x * half_way[0] + y * half_way[1] + z * half_way[2];
            const double shown = scene.two_sided ? __builtin_fabs(lambert) : lambert;
            half[n] = shown > 0 ? (scene.two_sided ? __builtin_fabs(towards_half) : towards_half) : 0.0;
            lit[n] = diffuse * most(shown, 0.0);
        }
        if (scene.specular) {
            VOLSPLAT_INDEPENDENT
            for (int n = 0; n < count_; ++n) lit[n] += power_of(half[n], scene.specular_power);
        }
        VOLSPLAT_INDEPENDENT
        for (int n = 0; n < count_; ++n) lit[n] = size_[n] < kNoGradient ? 0.0 : lit[n];
    }

    // The byte of the field that indexes a table.
    void index(int table, std::int32_t (&found)[kAtOnce]) const {
        const Field field = view_.scene->cross_bar[table];
        if (field == Field::density) {
            each(found, [&](int n) { return (from_[n] + to_[n]) / 2 + 0.5; });
        } else if (field == Field::strength) {
            each(found, [&](int n) { return size_[n] * view_.grid->strength + 0.5; });
        } else if (field <= Field::gradient_k) {
            const auto& axis = view_.grid->axes[static_cast<int>(field) - static_cast<int>(Field::gradient_i)];
            each(found, [&](int n) {
                const double along = gradient_[0][n] * axis[0] + gradient_[1][n] * axis[1] + gradient_[2][n] * axis[2];
                return 128.5 + (size_[n] < kNoGradient ? 0 : 127 * along / most(size_[n], kNoGradient));
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
            const auto voxel = static_cast<std::int64_t>(within(place_[axis][n], 0.0, static_cast<double>(dim)) + 0.5);
            const std::int64_t middle = voxel * factor + factor / 2;
            found[n] = static_cast<std::int32_t>(256 * (middle < dim ? middle : dim - 1) / dim);
        }
    }

    const SlabShadingView& view_;
    SlabSamples& samples_;
    int first_ = 0, count_ = 0;
    Reals from_, to_;  // densities at the two ends
    Reals differences_[3], gradient_[3], size_;
    Reals place_[3], thickness_;
    Reals low_, high_, depth_;
};

}  // namespace

void find_slab_colours(const SlabShadingView& view, SlabSamples& samples) { SlabColours(view, samples).find(); }

}  // namespace volsplat::VOLSPLAT_PATH
