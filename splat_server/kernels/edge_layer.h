// A layer of anti-aliased white lines.
#pragma once

#include <vector>

namespace volsplat {

class EdgeLayer {
public:
    EdgeLayer(int width, int height);

    // Positions in pixels from the centre of the top-left pixel, y down. Where lines cross, the greater coverage
    // counts.
    void draw(double x0, double y0, double x1, double y1, double line_width);

    const std::vector<float>& coverage() const { return coverage_; }  // height x width, 0..1
    int width() const { return width_; }
    int height() const { return height_; }

private:
    int width_, height_;
    std::vector<float> coverage_;
};

}  // namespace volsplat
