// What the sums of a complete block of planes come to: densities, and which slabs show anything.
#include "kernels/vectors.h"
#include "splat_kernels.h"
#include "splat_server/kernels/slab_sums.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr float kLeastDensity = 1e-30f, kGreatestDensity = 255.0f;  // 0 is not known

typedef float Block __attribute__((vector_size(kBlockPlanes * sizeof(float))));
typedef std::int32_t BlockBits __attribute__((vector_size(kBlockPlanes * sizeof(std::int32_t))));
typedef std::uint8_t BlockMarks __attribute__((vector_size(kBlockPlanes)));

Block all_alike(float value) { return Block{} + value; }

// At so many neighbouring pixels.
template <class Number>
void find_densities(const SlabSums& sums, void* block, int pixels) {
    typedef SumLayout<Number> Layout;
    typedef typename Layout::Quotient Quotient;
    typedef typename Layout::Signed Signed;
    constexpr Number kBelow = (Number{1} << Layout::kDensityBits) - 1;
    const auto bias = static_cast<Number>(sums.bias);
    const auto no_weight = static_cast<std::int32_t>(bias >> Layout::kDensityBits);
    const auto no_density = static_cast<Signed>(bias & kBelow);
    const std::int64_t step = sums.planes;
    Number* planes = static_cast<Number*>(block);
    for (int pixel = 0; pixel < pixels; ++pixel, planes += step) {
        Number numbers[kBlockPlanes];
        float densities[kBlockPlanes];
        __builtin_memcpy(numbers, planes, sizeof numbers);
        for (int n = 0; n < kBlockPlanes; ++n) {
            const Number number = numbers[n] + bias;
            const auto weight = static_cast<std::int32_t>(number >> Layout::kDensityBits) - no_weight;
            const Signed weighted = static_cast<Signed>(number & kBelow) - no_density;
            const Quotient below = static_cast<Quotient>(weight > 1 ? weight : 1);
            const float quotient = static_cast<float>(static_cast<Quotient>(weighted) / below);
            const float density = quotient < kGreatestDensity ? quotient : kGreatestDensity;
            densities[n] = weight < sums.least ? 0.0f : density > kLeastDensity ? density : kLeastDensity;
        }
        __builtin_memcpy(planes, densities, sizeof densities);
    }
}

}  // namespace

void find_slab_densities(const SlabSums& sums, void* block, int pixels) {
    find_densities<std::uint32_t>(sums, block, pixels);
}

void find_wide_slab_densities(const SlabSums& sums, void* block, int pixels) {
    find_densities<std::uint64_t>(sums, block, pixels);
}

// A slab shows what lies between the densities of its planes, of which one may not be known, and one table entry of it
// at least.
void find_shown_slabs(const SlabShadingView& view, const SlabDensities& densities, int pixels,
                      std::uint8_t (*shown)[kBlockPlanes]) {
    const Block first_visible = all_alike(static_cast<float>(view.first_visible - 1));
    const Block beyond_visible = all_alike(static_cast<float>(view.last_visible + 1));
    const float* planes = densities.planes;
    for (int pixel = 0; pixel < pixels; ++pixel, planes += densities.right) {
        const float* const kept = densities.kept + pixel * kKeptPlanes;
        Block behind = load<Block>(planes - 1), before = load<Block>(planes - 2);
        behind[0] = before[1] = kept[kKeptPlanes - 1];
        before[0] = kept[kKeptPlanes - 2];
        const Block front = before > 0 ? before : behind, back = behind > 0 ? behind : before;
        const Block low = front < back ? front : back, high = front < back ? back : front;
        const BlockBits found = (high > 0) & (low < beyond_visible) & (high >= first_visible);
        const BlockMarks marks = __builtin_convertvector(found & 1, BlockMarks);
        store(shown[pixel], marks);
    }
    if (view.visible_together) return;
    // Whether anything between them can be seen
    planes = densities.planes;
    for (int pixel = 0; pixel < pixels; ++pixel, planes += densities.right)
        for (int n = 0; n < kBlockPlanes; ++n) {
            if (!shown[pixel][n]) continue;
            const float* const kept = densities.kept + pixel * kKeptPlanes;
            const float before = n < 2 ? kept[kKeptPlanes - 2 + n] : planes[n - 2];
            const float behind = n < 1 ? kept[kKeptPlanes - 1] : planes[n - 1];
            const float front = before > 0 ? before : behind, back = behind > 0 ? behind : before;
            const float low = front < back ? front : back, high = front < back ? back : front;
            const auto first = static_cast<std::int32_t>(low < 255.0f ? low : 255.0f);
            const auto last = static_cast<std::int32_t>(high < 254.0f ? high : 254.0f) + 1;
            shown[pixel][n] = view.next_visible[first] <= last;
        }
}

}  // namespace volsplat::VOLSPLAT_PATH
