#include "image_publishing.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace volsplat {
namespace {

constexpr std::size_t kMostBlocks = 4;  // kept to be handed out again

typedef float Four __attribute__((vector_size(16)));
typedef int Places __attribute__((vector_size(16)));

Four four_at(const float* address) {
    Four four;
    std::memcpy(&four, address, sizeof four);
    return four;
}

// Four pixels, from planes of red, green, blue and alpha to pixels side by side.
void interleave(const float* row, std::int64_t plane, float* pixels) {
    const Four r = four_at(row), g = four_at(row + plane), b = four_at(row + 2 * plane), a = four_at(row + 3 * plane);
    const Places low = {0, 4, 1, 5}, high = {2, 6, 3, 7}, first = {0, 1, 4, 5}, second = {2, 3, 6, 7};
    const Four rg01 = __builtin_shuffle(r, g, low), rg23 = __builtin_shuffle(r, g, high);
    const Four ba01 = __builtin_shuffle(b, a, low), ba23 = __builtin_shuffle(b, a, high);
    const Four four[4] = {__builtin_shuffle(rg01, ba01, first), __builtin_shuffle(rg01, ba01, second),
                          __builtin_shuffle(rg23, ba23, first), __builtin_shuffle(rg23, ba23, second)};
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

}  // namespace

void publish(const ImageMemory& image, float* target) {
    const std::size_t row = static_cast<std::size_t>(image.width()) * 4;
    const int begin = std::min(image.row_begin(), image.height()), end = std::max(image.row_end(), begin);
    std::memset(target, 0, begin * row * sizeof(float));
    for (int y = begin; y < end; ++y) publish_row(image.row(y), image.plane(), image.width(), target + y * row);
    std::memset(target + end * row, 0, (image.height() - end) * row * sizeof(float));
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
