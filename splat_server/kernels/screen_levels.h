// What a screen shows of an image: 8 bits a channel, over a background.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>

namespace volsplat {

// `pixels` are `count` of 4 floats, associated; `levels` become `count` of 4 bytes: red, green, blue, nothing.
void screen_levels(const float* pixels, std::size_t count, const std::array<float, 3>& background, std::uint8_t* levels);

}  // namespace volsplat
