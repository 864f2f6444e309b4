// The 2-D table of a scene, over density and strength: what patches of that plane give at each of its entries
// (protocol/description/patches.py). The same bits on every machine.
#pragma once

#include <array>
#include <vector>

namespace volsplat {

constexpr int kTableEntries = 256;
constexpr int kPlaneEntries = kTableEntries * kTableEntries;  // at density | strength << 8

// A trapezium between two strengths; positions are 0 to 1.
struct Patch {
    double lower[2], upper[2];  // left and right end at either strength
    double strength[2];
    double soft, opacity;
    double emit[3], refl[3];
};

struct PatchTable {
    explicit PatchTable(const std::vector<Patch>& patches);

    std::vector<double> opacity = std::vector<double>(kPlaneEntries);
    std::vector<float> emit = std::vector<float>(4 * kPlaneEntries), refl = emit;  // red, green, blue and 0
};

}  // namespace volsplat
