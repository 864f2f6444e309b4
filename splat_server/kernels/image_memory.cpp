#include "image_memory.h"

#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>

#include "splat_job.h"

namespace volsplat {

ImageMemory::ImageMemory(int width, int height) : width_(width), height_(height) {
    if (width < 1 || width > 65535 || height < 1 || height > 65535)
        throw std::invalid_argument("an image must be 1 to 65535 pixels wide and high");
    pitch_ = (width + kVectorPixels - 1) / kVectorPixels * kVectorPixels;
    auto* memory = static_cast<float*>(std::aligned_alloc(64, pitch_ * height * 4 * sizeof(float)));
    if (!memory) throw std::bad_alloc();
    pixels_.reset(memory);
    clear();
}

void ImageMemory::Free::operator()(float* memory) const { std::free(memory); }

void ImageMemory::clear() { std::memset(pixels_.get(), 0, pitch_ * height_ * 4 * sizeof(float)); }

void ImageMemory::copy_to(float* target) const {
    const std::size_t row = static_cast<std::size_t>(width_) * 4;
    for (int y = 0; y < height_; ++y)
        std::memcpy(target + y * row, pixels_.get() + y * pitch_ * 4, row * sizeof(float));
}

}  // namespace volsplat
