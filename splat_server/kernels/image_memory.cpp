#include "image_memory.h"

#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>

#include "splat_job.h"

namespace volsplat {
namespace {

constexpr std::int64_t kLinePixels = 64 / 16;  // of a cache line
constexpr int kPageLines = 64;                 // lines whose addresses agree in the lowest 12 bits repeat after these
constexpr int kFootprintRows = 15, kFootprintLines = 4;

// The processor takes a load for the data of a recent store where the lowest 12 bits of their addresses agree, and
// its first cache maps them to the same set. So the rows of one footprint must not lie whole pages apart.
bool rows_collide(std::int64_t row_lines) {
    for (int rows = 1; rows <= kFootprintRows; ++rows) {
        const auto apart = static_cast<int>(row_lines * rows % kPageLines);
        if (apart < kFootprintLines || apart > kPageLines - kFootprintLines) return true;
    }
    return false;
}

}  // namespace

ImageMemory::ImageMemory(int width, int height) : width_(width), height_(height) {
    if (width < 1 || width > 65535 || height < 1 || height > 65535)
        throw std::invalid_argument("an image must be 1 to 65535 pixels wide and high");
    static_assert(kLinePixels % kVectorPixels == 0);
    std::int64_t row_lines = (width + kLinePixels - 1) / kLinePixels;
    while (rows_collide(row_lines)) ++row_lines;
    pitch_ = row_lines * kLinePixels;
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
