#include "image_memory.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>

namespace volsplat {
namespace {

constexpr int kGroupLines = kGroupFloats * sizeof(float) / 64;  // cache lines
constexpr int kPageLines = 64;  // lines whose addresses agree in the lowest 12 bits repeat after these
constexpr int kFootprintRows = 12, kFootprintLines = 3 * kGroupLines;

// The processor takes a load for the data of a recent store where the lowest 12 bits of their addresses agree, and
// its first cache maps them to the same set. So the rows of one footprint should not lie whole pages apart: these are
// the pairs of rows of one footprint that do.
int colliding_rows(std::int64_t row_lines) {
    int colliding = 0;
    for (int rows = 1; rows < kFootprintRows; ++rows) {
        const auto apart = static_cast<int>(row_lines * rows % kPageLines);
        if (apart < kFootprintLines || apart > kPageLines - kFootprintLines) colliding += kFootprintRows - rows;
    }
    return colliding;
}

// The groups of a row with its margin: one more than needed here and there, where that parts the rows.
std::int64_t groups_per_row(int width) {
    const std::int64_t least = (width + kGroupPixels - 1) / kGroupPixels + kMarginGroups;
    std::int64_t best = least;
    for (std::int64_t groups = least; groups < least + kPageLines / kGroupLines; ++groups)
        if (colliding_rows(groups * kGroupLines) < colliding_rows(best * kGroupLines)) best = groups;
    return best;
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
    pitch_ = groups_per_row(width) * kGroupFloats;
    // The margin after a row is that before the next.
    const std::size_t margin = static_cast<std::size_t>(kMarginGroups) * kGroupFloats;
    const std::size_t bytes = (pitch_ * height + 2 * margin) * sizeof(float);
    memory_.reset(static_cast<float*>(std::aligned_alloc(64, bytes)));
    if (!memory_) throw std::bad_alloc();
    std::memset(memory_.get(), 0, bytes);
    first_group_ = memory_.get() + margin;
    closed_tiles_.assign(tile_rows_ * tile_words_ + 1, 0);
    clear();
}

void ImageMemory::Free::operator()(float* memory) const { std::free(memory); }

void ImageMemory::clear() {
    if (row_begin_ < row_end_)
        std::memset(first_group_ + row_begin_ * pitch_, 0, (row_end_ - row_begin_) * pitch_ * sizeof(float));
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
    return {first_group_, pitch_, width_, height_, closed_tiles_.data(), tile_words_};
}

}  // namespace volsplat
