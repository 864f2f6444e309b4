// What a region's frame of slabs spends its time on.
#pragma once

#include <chrono>
#include <cstdint>

namespace volsplat {

struct SlabSeconds {
    double adding = 0;       // voxels' kernels to the planes: finding, sorting and adding them
    double densities = 0;    // the planes' sums brought to densities, and moved on
    double shading = 0;      // which slabs show anything, their gradients, classification and light
    double compositing = 0;  // slabs laid behind what is in front, and tiles noted that are closed

    SlabSeconds& operator+=(const SlabSeconds& other) {
        adding += other.adding, densities += other.densities, shading += other.shading;
        compositing += other.compositing;
        return *this;
    }
};

// Adds the time from lap to lap to a stage.
class LapClock {
public:
    void start() { last_ = std::chrono::steady_clock::now(); }
    void lap(double& stage) {
        const auto now = std::chrono::steady_clock::now();
        stage += std::chrono::duration<double>(now - last_).count();
        last_ = now;
    }

private:
    std::chrono::steady_clock::time_point last_;
};

// Likewise, but only of some turns among many: what is too short for a clock is told as a share of a longer time.
class SampledClock {
public:
    void start() {
        running_ = turn_++ % kEvery == 0;
        if (running_) clock_.start();
    }
    void lap(double& stage) {
        if (running_) clock_.lap(stage);
    }

private:
    static constexpr std::uint32_t kEvery = 13;  // a prime: not the same tiles of each row of tiles

    LapClock clock_;
    std::uint32_t turn_ = 0;
    bool running_ = false;
};

}  // namespace volsplat
