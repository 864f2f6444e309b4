#include "image_publishing.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "four_by_four.h"

namespace volsplat {

namespace {

constexpr std::size_t kMostBlocks = 4;  // kept to be handed out again

FourFloats four_at(const float* address) {
    FourFloats four;
    std::memcpy(&four, address, sizeof four);
    return four;
}

// Four pixels, from planes of red, green, blue and alpha to pixels side by side.
void interleave(const float* row, std::int64_t plane, float* pixels) {
    FourFloats four[4] = {four_at(row), four_at(row + plane), four_at(row + 2 * plane), four_at(row + 3 * plane)};
    transpose(four);
    std::memcpy(pixels, four, sizeof four);
}

void publish_row(const float* row, std::int64_t plane, int width, float* target) {
    int x = 0;
    for (; x + 4 <= width; x += 4) interleave(row + x, plane, target + x * 4);
    if (x == width) return;
    float rest[16];
    interleave(row + x, plane, rest);
    std::memcpy(target + x * 4, rest, (width - x) * 4 * sizeof(float));
}

void publish_rows(const ImageMemory& image, RowSpan rows, float* target) {
    for (int y = rows.begin; y < rows.end; ++y)
        publish_row(image.line(y), image.plane(), image.width(), target + std::int64_t(y) * image.width() * 4);
}

// Four pixels of each of some columns, at most four, from row y on.
void publish_block(const ImageMemory& image, int x, int columns, int y, float* target) {
    const std::size_t row = static_cast<std::size_t>(image.width()) * 4;
    const int rows = std::min(4, image.height() - y);
    float block[4][16];
    for (int n = 0; n < columns; ++n) interleave(image.line(x + n) + y, image.plane(), block[n]);
    for (int r = 0; r < rows; ++r)
        for (int n = 0; n < columns; ++n)
            std::memcpy(target + (y + r) * row + (x + n) * 4, block[n] + r * 4, 4 * sizeof(float));
}

// By bands of rows, so that what is read and written of a block stays in the first cache for its neighbours.
void publish_columns(const ImageMemory& image, RowSpan columns, float* target) {
    constexpr int kBand = kLinePixels;
    for (int top = 0; top < image.height(); top += kBand) {
        const int bottom = std::min(top + kBand, image.height());
        for (int x = columns.begin; x < columns.end; x += 4)
            for (int y = top; y < bottom; y += 4) publish_block(image, x, std::min(4, columns.end - x), y, target);
    }
}

void clear_lines(const ImageMemory& image, RowSpan lines, float* target) {
    const std::int64_t row = std::int64_t(image.width()) * 4;
    if (lines.begin >= lines.end) return;
    if (!image.turned()) {
        std::memset(target + lines.begin * row, 0, (lines.end - lines.begin) * row * sizeof(float));
        return;
    }
    for (int y = 0; y < image.height(); ++y)
        std::memset(target + y * row + lines.begin * 4, 0, (lines.end - lines.begin) * 4 * sizeof(float));
}

}  // namespace

void publish(const ImageMemory& image, float* target) { publish_lines(image, {0, image.lines()}, target); }

void publish_lines(const ImageMemory& image, RowSpan lines, float* target) {
    const int begin = std::clamp(image.line_begin(), lines.begin, lines.end);
    const int end = std::clamp(image.line_end(), begin, lines.end);
    clear_lines(image, {lines.begin, begin}, target);
    if (image.turned()) publish_columns(image, {begin, end}, target);
    else publish_rows(image, {begin, end}, target);
    clear_lines(image, {end, lines.end}, target);
}

void publish_between(const ImageMemory& image, const EdgeLayer& front, const EdgeLayer& back, float* target) {
    for (const EdgeLayer* layer : {&front, &back})
        if (layer->width() != image.width() || layer->height() != image.height())
            throw std::invalid_argument("the edge layers and the image differ in size");
    publish(image, target);
    const std::size_t pixels = static_cast<std::size_t>(image.width()) * image.height();
    for (std::size_t pixel = 0; pixel < pixels; ++pixel, target += 4) {
        const float before = front.coverage()[pixel], behind = back.coverage()[pixel];
        const float open = 1.0f - target[3];
        for (int c = 0; c < 4; ++c) target[c] = before + (1.0f - before) * (target[c] + open * behind);
    }
}

std::shared_ptr<float[]> ImageBlocks::free_block() {
    for (const auto& block : blocks_)
        if (block.use_count() == 1) return block;
    std::shared_ptr<float[]> block(new float[floats_]);
    if (blocks_.size() < kMostBlocks) blocks_.push_back(block);
    return block;
}

}  // namespace volsplat
