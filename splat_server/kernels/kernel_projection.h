// P(rho): a radial kernel integrated along the line of sight, scaled to integrate to 1 over the plane.
// The kernels are defined in protocol/rules/footprint_shape.py.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace volsplat {

class KernelProjection {
public:
    // `parameter` is sigma in voxels for "gaussian" and alpha for "kaiser-bessel"; the others have none.
    // Throws std::invalid_argument for an unknown kernel or a radius that is not positive.
    KernelProjection(const std::string& kernel, double parameter, double radius);
    // (1 - q)^2 times the polynomial of q with these coefficients, the constant one first; q = (r / radius)^2. It may
    // be below 0, which `at_square` is not made for.
    KernelProjection(const std::vector<double>& coefficients, double radius);

    double radius() const { return radius_; }
    bool has_negative_weights() const { return has_negative_weights_; }
    // The kernel itself at a distance below the radius, scaled to integrate to 1 over space.
    double density(double rho) const { return kernel_(rho) / over_space_; }
    // P at rho^2 (voxels^2); 0 from the radius on.
    double at_square(double rho_square) const;
    // amplitude * P over the half chord Z = sqrt(R^2 - rho^2) from 0 to R in equal steps, fine enough for linear
    // interpolation, and the last entry once more.
    std::vector<float> over_half_chord(double amplitude) const;

private:
    KernelProjection(const std::function<double(double)>& kernel, double radius, bool has_negative_weights);

    // P at Z = place / kChordIntervals * R.
    double at_place(double place) const;

    double radius_;
    bool has_negative_weights_;
    std::function<double(double)> kernel_;
    double over_space_;  // its integral
    // P over Z = sqrt(R^2 - rho^2), in which it is smooth up to the rim, with one more entry on either side.
    std::vector<double> over_half_chord_;
};

}  // namespace volsplat
