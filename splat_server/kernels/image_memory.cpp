#include "image_memory.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace volsplat {

namespace {

// An odd number of cache lines, so that the lines of one footprint are spread over the first cache, and that a load is
// not taken for the data of a recent store whose address has the same lowest 12 bits.
std::int64_t plane_of(int pixels) {
    return ((pixels + 2 * kMarginPixels + kLinePixels - 1) / kLinePixels | 1) * kLinePixels;
}

int checked(int pixels) {
    if (pixels < 1 || pixels > 65535) throw std::invalid_argument("an image must be 1 to 65535 pixels wide and high");
    return pixels;
}

// Of the map that takes more of an image's two.
std::int64_t words_of_tiles(int width, int height) {
    return std::max(tile_rows(height) * tile_words(width), tile_rows(width) * tile_words(height));
}

}  // namespace

ImageMemory::ImageMemory(int width, int height)
    : width_(checked(width)),
      height_(checked(height)),
      memory_(zeros(4 * std::max(plane_of(width) * height, plane_of(height) * width))),
      first_pixel_(memory_.get() + kMarginPixels),
      closed_tiles_(words_of_tiles(width, height) + 1) {
    lay_out(false);
}

void ImageMemory::lay_out(bool turned) {
    turned_ = turned;
    line_pixels_ = turned ? height_ : width_;
    lines_ = turned ? width_ : height_;
    plane_ = plane_of(line_pixels_);
    std::fill(closed_tiles_.begin(), closed_tiles_.end(), 0);
}

void ImageMemory::empty(RowSpan lines) {
    if (lines.begin >= lines.end) return;
    std::memset(memory_.get() + lines.begin * 4 * plane_, 0, (lines.end - lines.begin) * 4 * plane_ * sizeof(float));
}

ImageView ImageMemory::view() {
    return {first_pixel_, plane_, 4 * plane_, line_pixels_, lines_, closed_tiles(), tile_words()};
}

}  // namespace volsplat
