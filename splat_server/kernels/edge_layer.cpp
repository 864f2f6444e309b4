#include "edge_layer.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace volsplat {

namespace {

// Cuts the segment to the image grown by `margin`; false where nothing is left.
bool cut_to_image(double& x0, double& y0, double& x1, double& y1, double width, double height, double margin) {
    double begin = 0, end = 1;
    const double dx = x1 - x0, dy = y1 - y0;
    const double distances[4][2] = {
        {-dx, x0 + margin}, {dx, width - 1 + margin - x0}, {-dy, y0 + margin}, {dy, height - 1 + margin - y0}};
    for (const auto& [slope, room] : distances) {
        if (slope == 0) {
            if (room < 0) return false;
        } else if (slope < 0) {
            begin = std::max(begin, room / slope);
        } else {
            end = std::min(end, room / slope);
        }
    }
    if (begin > end) return false;
    x1 = x0 + end * dx, y1 = y0 + end * dy;
    x0 += begin * dx, y0 += begin * dy;
    return true;
}

}  // namespace

EdgeLayer::EdgeLayer(int width, int height) : width_(width), height_(height) {
    if (width < 1 || height < 1) throw std::invalid_argument("an edge layer needs a size");
    coverage_.assign(static_cast<std::size_t>(width) * height, 0.0f);
}

void EdgeLayer::draw(double x0, double y0, double x1, double y1, double line_width) {
    const double reach = line_width / 2 + 0.5;  // where coverage ends
    if (!cut_to_image(x0, y0, x1, y1, width_, height_, reach + 1)) return;
    const double dx = x1 - x0, dy = y1 - y0, square = dx * dx + dy * dy;
    const double lowest = std::max(std::floor(std::min(y0, y1) - reach), 0.0);
    const double highest = std::min(std::ceil(std::max(y0, y1) + reach), height_ - 1.0);
    for (int y = static_cast<int>(lowest); y <= highest; ++y) {
        // The part of the segment near this row bounds the columns.
        double t0 = 0, t1 = 1;
        if (dy != 0) {
            const double ta = (y - reach - y0) / dy, tb = (y + reach - y0) / dy;
            t0 = std::clamp(std::min(ta, tb), 0.0, 1.0), t1 = std::clamp(std::max(ta, tb), 0.0, 1.0);
        }
        const double xa = x0 + t0 * dx, xb = x0 + t1 * dx;
        const double left = std::max(std::floor(std::min(xa, xb) - reach), 0.0);
        const double right = std::min(std::ceil(std::max(xa, xb) + reach), width_ - 1.0);
        for (int x = static_cast<int>(left); x <= right; ++x) {
            const double along = square > 0 ? std::clamp(((x - x0) * dx + (y - y0) * dy) / square, 0.0, 1.0) : 0.0;
            const double distance = std::hypot(x - x0 - along * dx, y - y0 - along * dy);
            const auto covered = static_cast<float>(std::clamp(reach - distance, 0.0, std::min(line_width, 1.0)));
            float& coverage = coverage_[static_cast<std::size_t>(y) * width_ + x];
            coverage = std::max(coverage, covered);
        }
    }
}

}  // namespace volsplat
