#include "screen_levels.h"

#include <algorithm>

namespace volsplat {

void screen_levels(const float* pixels, std::size_t count, const std::array<float, 3>& background, std::uint8_t* levels) {
    const float behind[4] = {background[0], background[1], background[2], 0.0f};
    for (std::size_t n = 0; n < count; ++n, pixels += 4, levels += 4) {
        const float open = 1.0f - pixels[3];
        for (int c = 0; c < 4; ++c) {
            const float level = (pixels[c] + open * behind[c]) * 255.0f + 0.5f;
            levels[c] = static_cast<std::uint8_t>(static_cast<int>(std::min(std::max(level, 0.0f), 255.0f)));
        }
    }
}

}  // namespace volsplat
