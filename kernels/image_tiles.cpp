#include "image_tiles.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <stdexcept>

namespace volsplat {

namespace {

int tiles_along(int pixels) {
    if (pixels < 1 || pixels > 65535) throw std::invalid_argument("an image must be 1 to 65535 pixels wide and high");
    return (pixels + kImageTileSide - 1) / kImageTileSide;
}

// The nearest of 0, 1/255, …, 1.
void tell(float value, std::uint8_t& told) {
    const float within = value > 0 ? (value < 1 ? value : 1) : 0;
    told = static_cast<std::uint8_t>(static_cast<int>(within * 255 + 0.5f));
}

void tell(float value, std::uint32_t& told) { told = std::bit_cast<std::uint32_t>(value); }

void show(std::uint8_t told, float& value) { value = static_cast<float>(told) * (1.0f / 255); }

void show(std::uint32_t told, float& value) { value = std::bit_cast<float>(told); }

// What a plane through the neighbours misses each value by.
template <class Value>
void predict(const Value (*values)[kImageTileSide], Value (*misses)[kImageTileSide]) {
    for (int y = 0; y < kImageTileSide; ++y) {
        Value steps[kImageTileSide];  // from the row above
        for (int x = 0; x < kImageTileSide; ++x) steps[x] = values[y][x] - (y ? values[y - 1][x] : 0);
        misses[y][0] = steps[0];
        for (int x = 1; x < kImageTileSide; ++x) misses[y][x] = steps[x] - steps[x - 1];
    }
}

// The values again.
template <class Value>
void restore(const Value (*misses)[kImageTileSide], Value (*values)[kImageTileSide]) {
    for (int y = 0; y < kImageTileSide; ++y) {
        Value step = 0;
        for (int x = 0; x < kImageTileSide; ++x) values[y][x] = step += misses[y][x];
        for (int x = 0; y && x < kImageTileSide; ++x) values[y][x] += values[y - 1][x];
    }
}

}  // namespace

template <class Value>
ImageTiles<Value>::ImageTiles(int width, int height)
    : width_(width),
      height_(height),
      rows_(tiles_along(height)),
      columns_(tiles_along(width)),
      values_(tiles() * kImageTilePixels * kChannels) {}

template <class Value>
void ImageTiles<Value>::read(const float* pixels, int row, int column, Tile& tile) const {
    const int left = column * kImageTileSide, top = row * kImageTileSide;
    const int width = std::min(kImageTileSide, width_ - left), height = std::min(kImageTileSide, height_ - top);
    if (width < kImageTileSide || height < kImageTileSide) std::memset(tile, 0, sizeof tile);
    for (int y = 0; y < height; ++y) {
        const float* const from = pixels + (static_cast<std::size_t>(top + y) * width_ + left) * kChannels;
        Value told[kImageTileSide * kChannels];
        for (int n = 0; n < width * kChannels; ++n) tell(from[n], told[n]);
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < kChannels; ++c) tile[c][y][x] = told[x * kChannels + c];
    }
}

template <class Value>
void ImageTiles<Value>::write(const Value* tile, int row, int column, float* pixels) const {
    const int left = column * kImageTileSide, top = row * kImageTileSide;
    const int width = std::min(kImageTileSide, width_ - left), height = std::min(kImageTileSide, height_ - top);
    for (int y = 0; y < height; ++y) {
        float* const to = pixels + (static_cast<std::size_t>(top + y) * width_ + left) * kChannels;
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < kChannels; ++c)
                show(tile[c * kImageTilePixels + y * kImageTileSide + x], to[x * kChannels + c]);
    }
}

template <class Value>
std::size_t ImageTiles<Value>::note(const float* pixels, std::uint8_t* changed) {
    std::fill(changed, changed + (tiles() + 7) / 8, 0);
    std::size_t count = 0;
    Tile tile;
    for (std::size_t number = 0; number < tiles(); ++number) {
        read(pixels, static_cast<int>(number / columns_), static_cast<int>(number % columns_), tile);
        if (!std::memcmp(tile, tile_at(number), sizeof tile)) continue;
        std::memcpy(tile_at(number), tile, sizeof tile);
        changed[number / 8] |= 1 << number % 8;
        ++count;
    }
    return count;
}

template <class Value>
void ImageTiles<Value>::planes(const std::uint8_t* changed, std::size_t count, std::uint8_t* target) const {
    constexpr int kBytes = sizeof(Value);
    std::size_t place = 0;
    for (std::size_t number = 0; number < tiles(); ++number) {
        if (!(changed[number / 8] >> number % 8 & 1)) continue;
        for (int c = 0; c < kChannels; ++c) {
            const Value* const plane = tile_at(number) + c * kImageTilePixels;
            Value misses[kImageTileSide][kImageTileSide];
            predict(reinterpret_cast<const Value(*)[kImageTileSide]>(plane), misses);
            for (int byte = 0; byte < kBytes; ++byte) {
                std::uint8_t* const to = target + ((c * kBytes + byte) * count + place) * kImageTilePixels;
                for (int n = 0; n < kImageTilePixels; ++n) to[n] = (&misses[0][0])[n] >> 8 * byte & 255;
            }
        }
        ++place;
    }
}

template <class Value>
void ImageTiles<Value>::take(const std::uint8_t* changed, std::size_t count, const std::uint8_t* planes) {
    constexpr int kBytes = sizeof(Value);
    std::size_t place = 0;
    for (std::size_t number = 0; number < tiles() && place < count; ++number) {
        if (!(changed[number / 8] >> number % 8 & 1)) continue;
        for (int c = 0; c < kChannels; ++c) {
            Value misses[kImageTileSide][kImageTileSide] = {};
            for (int byte = 0; byte < kBytes; ++byte) {
                const std::uint8_t* const from = planes + ((c * kBytes + byte) * count + place) * kImageTilePixels;
                for (int n = 0; n < kImageTilePixels; ++n)
                    (&misses[0][0])[n] |= static_cast<Value>(from[n]) << 8 * byte;
            }
            Value* const plane = tile_at(number) + c * kImageTilePixels;
            restore(misses, reinterpret_cast<Value(*)[kImageTileSide]>(plane));
        }
        ++place;
    }
}

template <class Value>
void ImageTiles<Value>::lay_out(float* pixels) const {
    for (std::size_t number = 0; number < tiles(); ++number)
        write(tile_at(number), static_cast<int>(number / columns_), static_cast<int>(number % columns_), pixels);
}

template class ImageTiles<std::uint8_t>;
template class ImageTiles<std::uint32_t>;

}  // namespace volsplat
