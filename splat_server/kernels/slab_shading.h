// How the densities of a slab become colour and opacity: after reconstruction, through the scene's tables and light
// (paper: "Shading"; integrated over the density from plane to plane after Engel et al. 2001).
//
// Opacity is that of a thickness of one reference spacing, so that a slab has the optical depth -log(1 - opacity) times
// its thickness. The tables are steps, an entry for the densities that round to it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/field.h"

namespace volsplat {

constexpr int kTableEntries = 256;

typedef std::array<double, 3> Vector3;
typedef std::array<Vector3, 3> Matrix3;
typedef std::array<Vector3, kTableEntries> ColourEntries;
typedef std::array<double, kTableEntries> ScalarEntries;

struct SlabScene {
    std::array<Field, 4> cross_bar;  // of emit, refl, opac and modu
    ColourEntries emit, refl;
    ScalarEntries opac, modu;
    Vector3 light, half_way;  // physical axes
    bool diffuse, specular, two_sided;
    double specular_power;
};

struct SlabGrid {
    Matrix3 gradient;                       // from differences per pixel right, pixel down and plane to physical ones
    Vector3 axes[3];                        // unit vectors along i, j and k
    double strength;                        // bytes per unit of a physical gradient of densities
    std::array<double, 4> screen_bytes[3];  // of the fields screen x, y, z: at the grid's origin, and along i, j, k
    std::array<std::int64_t, 3> dims, factors;  // voxels of the volume, and those that one of the level stands for
};

struct SlabSample {
    double from, to;   // densities at its two ends
    double thickness;  // in reference spacings
    Vector3 gradient;  // of density, per pixel right, pixel down and plane
    Vector3 place;     // grid coordinates of its middle
};

struct SlabColour {
    Vector3 colour;
    double opacity;
};

class SlabShading {
public:
    SlabShading(const SlabScene& scene, const SlabGrid& grid);

    // Whether anything can be seen of densities from `low` to `high`.
    bool shows(float low, float high) const;
    SlabColour shade(const SlabSample& sample) const;

private:
    typedef std::array<double, kTableEntries + 1> Integral;  // from entry 0 to before each

    struct Span {  // of densities, from that of entry 0 on
        double low, high;
    };
    static Span span_of(double from, double to);
    static double between(const Integral& integral, const Span& span);

    bool by_density(int table) const { return scene_.cross_bar[table] == Field::density; }
    double depth(const Span& span, double others) const;
    Vector3 colour(int table, const Span& span, int index) const;
    double light(const Vector3& gradient, double size) const;
    int index(int table, const SlabSample& sample, const Vector3& gradient, double size) const;

    const SlabScene scene_;
    const SlabGrid grid_;
    std::array<int, kTableEntries + 1> next_visible_;
    std::vector<Integral> depths_;                    // by 255 times the opacity of what is not indexed by density
    std::array<std::array<Integral, 3>, 2> colours_;  // of emit and refl, times the depth
};

}  // namespace volsplat
