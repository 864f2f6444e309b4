// The image as it leaves the splat server: height x width x 4 float32, associated, edges included.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "edge_layer.h"
#include "image_memory.h"

namespace volsplat {

// `target` is height x width x 4.
void publish(const ImageMemory& image, float* target);

// Some lines of it.
void publish_lines(const ImageMemory& image, RowSpan lines, float* target);

// front over (image over back), white lines, associated: paper, "Combining".
// Throws std::invalid_argument where the sizes differ.
void publish_between(const ImageMemory& image, const EdgeLayer& front, const EdgeLayer& back, float* target);

// Blocks of memory that are handed out again once nobody else holds them: fresh ones cost a page fault for each page.
class ImageBlocks {
public:
    explicit ImageBlocks(std::size_t floats) : floats_(floats) {}
    std::size_t bytes() const { return floats_ * sizeof(float); }
    std::shared_ptr<float[]> free_block();

private:
    std::size_t floats_;
    std::vector<std::shared_ptr<float[]>> blocks_;
};

}  // namespace volsplat
