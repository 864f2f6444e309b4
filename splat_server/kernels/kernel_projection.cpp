#include "kernel_projection.h"

#include <cmath>
#include <functional>
#include <numbers>
#include <stdexcept>

namespace volsplat {

namespace {

constexpr int kChordIntervals = 1024;   // of the table over Z
constexpr int kLinearIntervals = 4096;  // of the table that is interpolated linearly
constexpr int kLineIntervals = 256;     // Simpson, along half a line of sight
constexpr int kRadialIntervals = 8192;  // Simpson, for the integral over space

// The modified Bessel function I2 by its power series; every term is positive, so nothing cancels.
double bessel_i2(double x) {
    const double quarter = x * x / 4;
    double term = quarter / 2, sum = term;
    for (int k = 1; term > sum * 1e-17 && k < 200; ++k) {
        term *= quarter / (k * (k + 2.0));
        sum += term;
    }
    return sum;
}

std::function<double(double)> radial_kernel(const std::string& name, double parameter, double radius) {
    if (name == "gaussian") {
        return [=](double r) { return std::exp(-r * r / (2 * parameter * parameter)); };
    }
    if (name == "bspline") {
        return [=](double r) {
            const double t = 2 * r / radius, u = 2 - t;
            return t < 1 ? 2.0 / 3 - t * t + t * t * t / 2 : (u > 0 ? u * u * u / 6 : 0.0);
        };
    }
    if (name == "kaiser-bessel") {
        return [=](double r) {
            const double square = 1 - (r / radius) * (r / radius);
            return square > 0 ? square * bessel_i2(parameter * std::sqrt(square)) : 0.0;
        };
    }
    if (name == "cone") {
        return [=](double r) { return r < radius ? 1 - r / radius : 0.0; };
    }
    throw std::invalid_argument("no kernel is called '" + name + "'");
}

std::function<double(double)> polynomial_kernel(const std::vector<double>& coefficients, double radius) {
    if (coefficients.empty()) throw std::invalid_argument("a kernel needs a coefficient");
    return [=](double r) {
        const double q = (r / radius) * (r / radius), edge = 1 - q;
        double sum = 0;
        for (auto one = coefficients.rbegin(); one != coefficients.rend(); ++one) sum = sum * q + *one;
        return edge > 0 ? edge * edge * sum : 0.0;
    };
}

double simpson(const std::function<double(double)>& f, double end, int intervals) {
    double sum = f(0.0) + f(end);
    for (int n = 1; n < intervals; ++n) sum += f(end * n / intervals) * (n % 2 ? 4 : 2);
    return sum * end / (3.0 * intervals);
}

}  // namespace

KernelProjection::KernelProjection(const std::string& kernel, double parameter, double radius)
    : KernelProjection(radial_kernel(kernel, parameter, radius), radius, false) {}

KernelProjection::KernelProjection(const std::vector<double>& coefficients, double radius)
    : KernelProjection(polynomial_kernel(coefficients, radius), radius, true) {}

KernelProjection::KernelProjection(const std::function<double(double)>& kernel, double radius,
                                   bool has_negative_weights)
    : radius_(radius), has_negative_weights_(has_negative_weights), kernel_(kernel) {
    if (!(radius > 0) || !std::isfinite(radius)) throw std::invalid_argument("a kernel's radius must be above 0");
    const auto& k = kernel_;
    over_space_ = simpson([&](double r) { return 4 * std::numbers::pi * r * r * k(r); }, radius, kRadialIntervals);
    over_half_chord_.resize(kChordIntervals + 3);
    double* entry = over_half_chord_.data() + 1;
    for (int n = 0; n <= kChordIntervals; ++n) {
        const double z_end = radius * n / kChordIntervals, rho_square = radius * radius - z_end * z_end;
        const auto along = [&](double z) { return k(std::sqrt(std::max(rho_square + z * z, 0.0))); };
        entry[n] = 2 * simpson(along, z_end, kLineIntervals) / over_space_;
    }
    entry[kChordIntervals + 1] = 3 * (entry[kChordIntervals] - entry[kChordIntervals - 1]) + entry[kChordIntervals - 2];
    entry[-1] = -entry[1];  // P is odd in Z at the rim
}

double KernelProjection::at_square(double rho_square) const {
    const double square = radius_ * radius_ - rho_square;
    return square > 0 ? at_place(std::sqrt(square) * (kChordIntervals / radius_)) : 0.0;
}

double KernelProjection::at_place(double place) const {
    int cell = static_cast<int>(place);
    if (cell >= kChordIntervals) cell = kChordIntervals - 1;
    const double t = place - cell;
    const double* p = over_half_chord_.data() + cell;
    // Cubic through the four entries around t.
    const double value = p[1] + t * ((p[2] - p[0]) / 2 + t * (p[0] - 2.5 * p[1] + 2 * p[2] - p[3] / 2 +
                                                              t * (1.5 * (p[1] - p[2]) + (p[3] - p[0]) / 2)));
    return value > 0 ? value : 0.0;
}

std::vector<float> KernelProjection::over_half_chord(double amplitude) const {
    std::vector<float> entries;
    entries.reserve(kLinearIntervals + 2);
    for (int n = 0; n <= kLinearIntervals; ++n)
        entries.push_back(
            static_cast<float>(amplitude * at_place(static_cast<double>(n) * kChordIntervals / kLinearIntervals)));
    entries.push_back(entries.back());
    return entries;
}

}  // namespace volsplat
