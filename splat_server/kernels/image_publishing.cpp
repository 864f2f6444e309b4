#include "image_publishing.h"

#include <algorithm>
#include <cstring>

#include "four_by_four.h"

namespace volsplat {

namespace {

constexpr std::size_t kMostKept = 4;  // kept to be handed out again

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

void publish_rows(const ImageMemory& image, RowSpan rows, const PixelBlock& target) {
    for (int y = rows.begin; y < rows.end; ++y)
        publish_row(image.line(y), image.plane(), image.width(), target.at(0, y));
}

// Four pixels of each of some columns, at most four, from row y on.
void publish_few(const ImageMemory& image, int x, int columns, int y, const PixelBlock& target) {
    const int rows = std::min(4, image.height() - y);
    float few[4][16];
    for (int n = 0; n < columns; ++n) interleave(image.line(x + n) + y, image.plane(), few[n]);
    for (int r = 0; r < rows; ++r)
        for (int n = 0; n < columns; ++n) std::memcpy(target.at(x + n, y + r), few[n] + r * 4, 4 * sizeof(float));
}

// By bands of rows, so that what is read and written of a block stays in the first cache for its neighbours.
void publish_columns(const ImageMemory& image, RowSpan columns, const PixelBlock& target) {
    constexpr int kBand = kLinePixels;
    for (int top = 0; top < image.height(); top += kBand) {
        const int bottom = std::min(top + kBand, image.height());
        for (int x = columns.begin; x < columns.end; x += 4)
            for (int y = top; y < bottom; y += 4) publish_few(image, x, std::min(4, columns.end - x), y, target);
    }
}

void clear_pixels(const Rectangle& rectangle, const PixelBlock& target) {
    for (int y = rectangle.top; y < rectangle.bottom && rectangle.left < rectangle.right; ++y)
        std::memset(target.at(rectangle.left, y), 0, rectangle.width() * 4 * sizeof(float));
}

}  // namespace

Rectangle rectangle_of(const ImageMemory& image, RowSpan lines) {
    return image.turned() ? Rectangle{lines.begin, 0, lines.end, image.height()}
                          : Rectangle{0, lines.begin, image.width(), lines.end};
}

void publish_lines(const ImageMemory& image, RowSpan lines, RowSpan drawn, const PixelBlock& target) {
    const int begin = std::clamp(drawn.begin, lines.begin, lines.end);
    const int end = std::clamp(drawn.end, begin, lines.end);
    clear_pixels(rectangle_of(image, {lines.begin, begin}), target);
    if (image.turned()) publish_columns(image, {begin, end}, target);
    else publish_rows(image, {begin, end}, target);
    clear_pixels(rectangle_of(image, {end, lines.end}), target);
}

void lay_between(const EdgeLayer& front, const EdgeLayer& behind, const Rectangle& rectangle, const PixelBlock& block) {
    for (int y = rectangle.top; y < rectangle.bottom; ++y)
        for (int x = rectangle.left; x < rectangle.right; ++x) {
            const std::size_t place = static_cast<std::size_t>(y) * front.width() + x;
            const float before = front.coverage()[place], after = behind.coverage()[place];
            float* const pixel = block.at(x, y);
            const float open = 1.0f - pixel[3];
            for (int c = 0; c < 4; ++c) pixel[c] = before + (1.0f - before) * (pixel[c] + open * after);
        }
}

void copy_pixels(const PixelBlock& from, const Rectangle& rectangle, const PixelBlock& to) {
    for (int y = rectangle.top; y < rectangle.bottom; ++y)
        std::memcpy(to.at(rectangle.left, y), from.at(rectangle.left, y), rectangle.width() * 4 * sizeof(float));
}

std::shared_ptr<float[]> ImageBlocks::free_block(std::size_t floats) {
    if (floats != floats_) blocks_.clear();
    floats_ = floats;
    for (const auto& block : blocks_)
        if (block.use_count() == 1) return block;
    std::shared_ptr<float[]> block(new float[floats]);
    if (blocks_.size() < kMostKept) blocks_.push_back(block);
    return block;
}

}  // namespace volsplat
