// Light that falls on rough directions: the mean over those that each of them stands for, whatever the view.
#pragma once

#include <vector>

namespace volsplat {

// Cosines of the angles between a mean direction and those that it stands for, all as likely.
using Cosines = std::vector<double>;

// What falls on directions spread evenly about an axis, by the cosine of the axis with the light.
class SpreadLight {
public:
    // `shine` is what a cosine of one direction gives.
    template <class Shine>
    SpreadLight(const Cosines& cosines, Shine shine);

    double at(double cosine) const;

private:
    std::vector<double> light_;
};

class RoughLight {
public:
    // For each of the roughnesses its cosines.
    RoughLight(const std::vector<Cosines>& roughness, bool two_sided, double specular_power);

    const SpreadLight& diffuse(int roughness) const { return diffuse_.at(roughness); }
    const SpreadLight& highlight(int roughness) const { return highlight_.at(roughness); }

private:
    std::vector<SpreadLight> diffuse_, highlight_;
};

}  // namespace volsplat
