#include "rough_light.h"

#include <algorithm>
#include <cmath>

#include "paths/map_shade_kernels.h"

namespace volsplat {

namespace {

constexpr int kSteps = 256;

// Of eight directions around an axis, half of which mirror the others: cosines of odd sixteenths of pi.
constexpr double kAround[] = {0.98078528040323044913, 0.83146961230254523708, 0.55557023301960222474,
                              0.19509032201612826785};

}  // namespace

template <class Shine>
SpreadLight::SpreadLight(const Cosines& cosines, Shine shine) : light_(kSteps + 1) {
    for (int n = 0; n <= kSteps; ++n) {
        const double along = 2.0 * n / kSteps - 1.0, aside = std::sqrt(1.0 - along * along);
        double sum = 0.0;
        for (double cosine : cosines) {
            const double sine = std::sqrt(1.0 - cosine * cosine);
            for (double around : kAround) {
                sum += shine(along * cosine + aside * sine * around) + shine(along * cosine - aside * sine * around);
            }
        }
        light_[n] = sum / (8.0 * static_cast<double>(cosines.size()));
    }
}

double SpreadLight::at(double cosine) const {
    const double place = (std::clamp(cosine, -1.0, 1.0) + 1.0) * (kSteps / 2.0);
    const int below = std::min(static_cast<int>(place), kSteps - 1);
    return light_[below] + (light_[below + 1] - light_[below]) * (place - below);
}

RoughLight::RoughLight(const std::vector<Cosines>& roughness, bool two_sided, double specular_power) {
    const auto seen = [&](double cosine) { return std::max(two_sided ? std::abs(cosine) : cosine, 0.0); };
    const auto power = map_shade_kernels().power;
    for (const Cosines& cosines : roughness) {
        diffuse_.emplace_back(cosines, seen);
        highlight_.emplace_back(cosines, [&](double cosine) {
            return seen(cosine) > 0.0 ? power(std::min(seen(cosine), 1.0), specular_power) : 0.0;
        });
    }
}

}  // namespace volsplat
