#include "image_memory.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace volsplat {
namespace {

constexpr std::int64_t kLinePixels = 64 / sizeof(float);  // of a cache line

// An odd number of cache lines, so that the rows of one footprint are spread over the first cache, and that a load is
// not taken for the data of a recent store whose address has the same lowest 12 bits.
std::int64_t plane_of(int width) {
    return ((width + 2 * kMarginPixels + kLinePixels - 1) / kLinePixels | 1) * kLinePixels;
}

std::int64_t tiles_along(int pixels) { return (pixels + kTileSide - 1) / kTileSide; }

}  // namespace

ImageMemory::ImageMemory(int width, int height)
    : width_(width),
      height_(height),
      row_begin_(0),
      row_end_(height),
      tile_rows_(tiles_along(height)),
      tile_words_((tiles_along(width) + 63) / 64) {
    if (width < 1 || width > 65535 || height < 1 || height > 65535)
        throw std::invalid_argument("an image must be 1 to 65535 pixels wide and high");
    plane_ = plane_of(width);
    memory_ = large_memory(plane_ * 4 * height);
    first_pixel_ = memory_.get() + kMarginPixels;
    closed_tiles_.assign(tile_rows_ * tile_words_ + 1, 0);
    clear();
}

void ImageMemory::clear() {
    if (row_begin_ < row_end_)
        std::memset(memory_.get() + row_begin_ * 4 * plane_, 0, (row_end_ - row_begin_) * 4 * plane_ * sizeof(float));
    row_begin_ = height_, row_end_ = 0;
    std::fill(closed_tiles_.begin(), closed_tiles_.end(), 0);
    hidden_packets_ = 0;
}

void ImageMemory::note(const SplatOutcome& outcome) {
    row_begin_ = std::min(row_begin_.load(), outcome.row_begin);
    row_end_ = std::max(row_end_.load(), outcome.row_end);
    hidden_packets_ += outcome.hidden;
}

ImageView ImageMemory::view() {
    return {first_pixel_, plane_, 4 * plane_, width_, height_, closed_tiles_.data(), tile_words_};
}

}  // namespace volsplat
