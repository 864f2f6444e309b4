// The image buffer's memory: float32 RGBA, rows padded to whole vectors, so that the splat loop may touch the
// pixels beside the image's right edge; they are never shown.
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>

namespace volsplat {

class ImageMemory {
public:
    // Throws std::invalid_argument for a size outside 1..65535, std::bad_alloc where memory lacks.
    ImageMemory(int width, int height);

    void clear();
    // Copies to height x width x 4 floats without padding.
    void copy_to(float* target) const;

    float* pixels() { return pixels_.get(); }
    const float* pixels() const { return pixels_.get(); }
    int width() const { return width_; }
    int height() const { return height_; }
    std::int64_t pitch() const { return pitch_; }

private:
    struct Free {
        void operator()(float* memory) const;
    };
    int width_, height_;
    std::int64_t pitch_;  // pixels
    std::unique_ptr<float[], Free> pixels_;
};

}  // namespace volsplat
