#include "reflected_light.h"

#include <algorithm>
#include <utility>

namespace volsplat {

ReflectedLight::ReflectedLight(std::vector<double> light, double step) : light_(std::move(light)), step_(step) {
    lit_.reserve(light_.size());
}

void ReflectedLight::add(double area, const std::int64_t* codes, const double* by_step, std::size_t n) {
    for (std::size_t at = 0; at < n; ++at) {
        const double light = light_[static_cast<std::size_t>(codes[at])];
        if (light == 0.0) continue;
        Lit& lit = lit_.emplace_back();
        lit.light = light;
        for (int step = 0; step < kLightSteps; ++step) lit.reflected[step] = area * by_step[at * kLightSteps + step];
    }
}

// Each step by itself, so that the compiler may take several at once.
double ReflectedLight::amount(double factor) const {
    std::array<double, kLightSteps> sums{};
    for (const Lit& lit : lit_) {
        const double light = lit.light * factor;
        for (int step = 0; step < kLightSteps; ++step)
            sums[step] += lit.reflected[step] * std::clamp(light - step_ * step, 0.0, step_);
    }
    double all = 0.0;
    for (const double sum : sums) all += sum;
    return all;
}

}  // namespace volsplat
