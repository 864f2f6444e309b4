#include "passed_light.h"

#include <cmath>
#include <stdexcept>
#include <utility>

namespace volsplat {

namespace {

constexpr double kLongestStep = 1 + 1e-9;  // rounding included
constexpr int kMostBlocks = 1 << 8;        // on an axis

int longest_axis(const LightStep& step) {
    int longest = 0;
    for (int axis = 1; axis < 3; ++axis)
        if (std::abs(step.step[axis]) > std::abs(step.step[longest])) longest = axis;
    return longest;
}

void check(const LightStep& step) {
    bool short_enough = step.length >= 0 && std::isfinite(step.length);
    for (const double part : step.step) short_enough = short_enough && std::abs(part) <= kLongestStep;
    if (!short_enough || std::abs(step.step[longest_axis(step)]) < 1 / kLongestStep)
        throw std::invalid_argument("light goes from slice to slice, no farther aside, for a finite length");
}

std::size_t blocks_in(const std::array<int, 3>& dims) {
    std::size_t count = 1;
    for (const int dim : dims) {
        if (dim < 1 || dim > kMostBlocks) throw std::invalid_argument("light passes 1 to 256 blocks on an axis");
        count *= static_cast<std::size_t>(dim);
    }
    return count;
}

// What comes of a slice; all of it beside the slice.
class Slice {
public:
    Slice(int columns, int rows) : columns_(columns), rows_(rows), light_(std::size_t(columns) * rows, 1.0) {}

    double& at(int column, int row) { return light_[row * columns_ + column]; }

    double between(double column, double row) const {
        const auto left = static_cast<int>(std::floor(column)), top = static_cast<int>(std::floor(row));
        const double right = column - left, down = row - top;
        return (1 - down) * ((1 - right) * seen(left, top) + right * seen(left + 1, top)) +
               down * ((1 - right) * seen(left, top + 1) + right * seen(left + 1, top + 1));
    }

private:
    double seen(int column, int row) const {
        const bool inside = 0 <= column && column < columns_ && 0 <= row && row < rows_;
        return inside ? light_[row * columns_ + column] : 1.0;
    }

    int columns_, rows_;
    std::vector<double> light_;
};

}  // namespace

PassedLight::PassedLight(const std::vector<std::uint16_t>& depths, double unit, const std::array<int, 3>& dims,
                         const std::vector<LightStep>& steps)
    : dims_(dims), shares_(blocks_in(dims), 0.0F) {
    if (depths.size() != shares_.size() || steps.empty() || !(unit > 0))
        throw std::invalid_argument("light passes as many blocks as there are depths, from a direction at least");
    for (const LightStep& step : steps) check(step);
    for (const LightStep& step : steps) pass(depths, unit, step);
    for (float& share : shares_) share /= static_cast<float>(steps.size());
}

void PassedLight::pass(const std::vector<std::uint16_t>& depths, double unit, const LightStep& step) {
    const int along = longest_axis(step), across = along == 0 ? 1 : 0, down = along == 2 ? 1 : 2;
    const int apart[] = {1, dims_[0], dims_[0] * dims_[1]};
    const int slices = dims_[along], way = step.step[along] > 0 ? -1 : 1;
    const double aside = step.step[across], below = step.step[down];
    Slice before(dims_[across], dims_[down]), next = before;
    for (int n = 0, slice = way > 0 ? 0 : slices - 1; n < slices; ++n, slice += way) {
        for (int row = 0; row < dims_[down]; ++row)
            for (int column = 0; column < dims_[across]; ++column) {
                const int block = slice * apart[along] + row * apart[down] + column * apart[across];
                const double light = before.between(column + aside, row + below);
                shares_[block] += static_cast<float>(light);
                next.at(column, row) = light * std::exp(-depths[block] / unit * step.length);
            }
        std::swap(before, next);
    }
}

}  // namespace volsplat
