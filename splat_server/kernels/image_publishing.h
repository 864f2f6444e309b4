// Lines of an image as they leave the splat server: rows of float32 RGBA, associated, edges included.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "edge_layer.h"
#include "image_memory.h"

namespace volsplat {

struct Rectangle {  // pixels of the published image
    int left, top, right, bottom;

    int width() const { return right - left; }
    int height() const { return bottom - top; }
    std::size_t floats() const { return static_cast<std::size_t>(width()) * height() * 4; }
};

// Where these lines lie in the published image.
Rectangle rectangle_of(const ImageMemory& image, RowSpan lines);

struct PixelBlock {
    float* pixels;  // of the rectangle, row by row
    Rectangle rectangle;

    std::int64_t row() const { return std::int64_t(rectangle.width()) * 4; }
    float* at(int x, int y) const { return pixels + (y - rectangle.top) * row() + (x - rectangle.left) * 4; }
};

// Those lines of the image outside of `drawn` are empty.
void publish_lines(const ImageMemory& image, RowSpan lines, RowSpan drawn, const PixelBlock& target);

// Lays the rectangle between white lines, associated: front over (block over behind) (paper, "Combining").
void lay_between(const EdgeLayer& front, const EdgeLayer& behind, const Rectangle& rectangle, const PixelBlock& block);

void copy_pixels(const PixelBlock& from, const Rectangle& rectangle, const PixelBlock& to);

// Blocks of memory that are handed out again once nobody else holds them: fresh ones cost a page fault for each page.
class ImageBlocks {
public:
    // Of one size at a time.
    std::shared_ptr<float[]> free_block(std::size_t floats);

private:
    std::size_t floats_ = 0;
    std::vector<std::shared_ptr<float[]>> blocks_;
};

}  // namespace volsplat
