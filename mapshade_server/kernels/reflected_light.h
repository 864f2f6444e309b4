// What a level reflects of a light, and of more of it: see frames/level_light.py.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "level_columns.h"

namespace volsplat {

class ReflectedLight {
public:
    // The light by direction code, taken in steps of `step`.
    ReflectedLight(std::vector<double> light, double step);

    // What is seen from one side, of so large an area: what voxels of n directions reflect of each step.
    void add(double area, const std::int64_t* codes, const double* by_step, std::size_t n);

    // All that is reflected if there is so many times the light.
    double amount(double factor) const;

private:
    struct Lit {
        double light;
        std::array<double, kLightSteps> reflected;
    };

    const std::vector<double> light_;
    const double step_;
    std::vector<Lit> lit_;  // directions that light falls on
};

}  // namespace volsplat
