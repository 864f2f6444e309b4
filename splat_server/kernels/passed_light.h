// How much light comes through the blocks of a volume to each of them (protocol/rules/light_blocks.py).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace volsplat {

// To the next slice of blocks towards where light comes from.
struct LightStep {
    std::array<double, 3> step;  // in blocks along i, j, k: 1 or -1 along one axis, no farther along others
    double length;               // reference spacings
};

class PassedLight {
public:
    // `depths` of each block, (k, j, i), in 1 / `unit`. The mean over the steps. Throws std::invalid_argument.
    PassedLight(const std::vector<std::uint16_t>& depths, double unit, const std::array<int, 3>& dims,
                const std::vector<LightStep>& steps);

    const std::array<int, 3>& dims() const { return dims_; }
    const float* shares() const { return shares_.data(); }

private:
    void pass(const std::vector<std::uint16_t>& depths, double unit, const LightStep& step);

    const std::array<int, 3> dims_;
    std::vector<float> shares_;
};

}  // namespace volsplat
