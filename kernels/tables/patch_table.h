// The 2-D table of a scene, over density and strength: what patches of that plane give at each of its entries
// (protocol/description/patches.py). The same bits on every machine.
#pragma once

#include <array>
#include <vector>

#include "table_means.h"

namespace volsplat {

constexpr int kPlaneEntries = kTableEntries * kTableEntries;  // at density | strength << 8

// A trapezium between two strengths; positions are 0 to 1.
struct Patch {
    double lower[2], upper[2];  // left and right end at either strength
    double strength[2];
    double soft, opacity;
    double emit[3], refl[3];
};

struct PatchTable {
    // Of densities spread by `spread` times the strength's byte to either side: the mean opacity, and what is emitted
    // and reflected on the mean over that opacity.
    PatchTable(const std::vector<Patch>& patches, double spread);

    std::vector<double> opacity = std::vector<double>(kPlaneEntries);
    std::vector<float> emit = std::vector<float>(4 * kPlaneEntries), refl = emit;  // red, green, blue and 0
};

}  // namespace volsplat
