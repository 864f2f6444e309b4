// Which tiles of an image have changed since the one before, and by what they are told (protocol/rules/image_tiles.py).
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/constants.h"

namespace volsplat {

// The images of one place and size, one after the other. The first comes after one of zeros. `Value` is what a channel
// of a pixel is told by: 8 bits, or all 32 of the float.
template <class Value>
class ImageTiles {
public:
    ImageTiles(int width, int height);

    std::size_t tiles() const { return static_cast<std::size_t>(rows_) * columns_; }
    static constexpr std::size_t kTileBytes = kImageTilePixels * kChannels * sizeof(Value);

    // Notes the image of height x width x 4 floats. Returns how many tiles have changed, whose bits are set in
    // `changed`.
    std::size_t note(const float* pixels, std::uint8_t* changed);
    // The planes of these tiles as they are now, predicted: so many times kTileBytes.
    void planes(const std::uint8_t* changed, std::size_t count, std::uint8_t* target) const;

    // At the other end: takes the planes of these tiles, and lays out the image that they make with all others.
    void take(const std::uint8_t* changed, std::size_t count, const std::uint8_t* planes);
    void lay_out(float* pixels) const;

private:
    using Tile = Value[kChannels][kImageTileSide][kImageTileSide];

    void read(const float* pixels, int row, int column, Tile& tile) const;
    void write(const Value* tile, int row, int column, float* pixels) const;
    Value* tile_at(std::size_t number) { return values_.data() + number * kImageTilePixels * kChannels; }
    const Value* tile_at(std::size_t number) const { return values_.data() + number * kImageTilePixels * kChannels; }

    const int width_, height_, rows_, columns_;
    std::vector<Value> values_;  // of the newest image: by tiles, in them by channels
};

extern template class ImageTiles<std::uint8_t>;
extern template class ImageTiles<std::uint32_t>;

}  // namespace volsplat
