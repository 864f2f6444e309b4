// What the sums of a complete block of planes come to: densities, and which slabs show anything.
#include "splat_kernels.h"
#include "splat_server/kernels/slab_sums.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr float kLeastDensity = 1e-30f;  // 0 is not known

// At so many neighbouring pixels.
template <class Number>
void find_densities(const SlabSums& sums, void* block, int pixels) {
    typedef SumLayout<Number> Layout;
    typedef typename Layout::Quotient Quotient;
    typedef typename Layout::Signed Signed;
    constexpr auto kLeast = static_cast<std::int32_t>(kLeastKnown * Layout::kUnit);
    const std::int64_t step = sums.planes;
    Number* planes = static_cast<Number*>(block);
    for (int pixel = 0; pixel < pixels; ++pixel, planes += step) {
        Number numbers[kBlockPlanes];
        float densities[kBlockPlanes];
        __builtin_memcpy(numbers, planes, sizeof numbers);
        for (int n = 0; n < kBlockPlanes; ++n) {
            const auto weight = static_cast<std::int32_t>(numbers[n] >> Layout::kDensityBits);
            const auto weighted = numbers[n] & ((Number{1} << Layout::kDensityBits) - 1);
            const Quotient below = static_cast<Quotient>(weight > 1 ? weight : 1);
            const auto above = static_cast<Quotient>(static_cast<Signed>(weighted));
            const float density = static_cast<float>(above / below);
            densities[n] = weight < kLeast ? 0.0f : density > kLeastDensity ? density : kLeastDensity;
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
void find_shown_slabs(const float (*densities)[kBlockPlanes + 1], int pixels, const std::int32_t* next_visible,
                      std::uint8_t (*shown)[kBlockPlanes]) {
    for (int pixel = 0; pixel < pixels; ++pixel) {
        const float* const planes = densities[pixel];
        for (int n = 0; n < kBlockPlanes; ++n) {
            const float front = planes[n] > 0 ? planes[n] : planes[n + 1];
            const float back = planes[n + 1] > 0 ? planes[n + 1] : planes[n];
            const float low = front < back ? front : back, high = front < back ? back : front;
            const auto first = static_cast<std::int32_t>(low < 255.0f ? low : 255.0f);
            const auto last = static_cast<std::int32_t>(high < 254.0f ? high : 254.0f) + 1;
            shown[pixel][n] = high > 0 && next_visible[first] <= last;
        }
    }
}

}  // namespace volsplat::VOLSPLAT_PATH
