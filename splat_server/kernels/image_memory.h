// The image buffer's memory: associated float32, each line of pixels as four planes of red, green, blue and alpha, so
// that the splat loop combines neighbouring pixels without shuffling. Planes lie between margins that the loop may
// write to. Lines are the rows of the image or, where its frame is planned with x and y exchanged, its columns: they
// become rows when it is published. Beside it, the map of closed tiles (protocol/rules/closed_tiles.py), by lines.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/large_memory.h"
#include "kernels/tile_map.h"
#include "splat_job.h"

namespace volsplat {

constexpr std::int64_t kLinePixels = 64 / sizeof(float);  // of a cache line, for one channel

class ImageMemory {
public:
    // Of so many pixels once it is published. Throws std::invalid_argument for a size outside 1..65535, std::bad_alloc
    // where memory lacks.
    ImageMemory(int width, int height);

    // Empties the map. All lines must be empty. From then on they are rows or, `turned`, columns.
    void lay_out(bool turned);
    void empty(RowSpan lines);

    ImageView view();
    int width() const { return width_; }
    int height() const { return height_; }
    bool turned() const { return turned_; }
    int lines() const { return lines_; }
    const float* line(int n) const { return first_pixel_ + n * 4 * plane_; }
    std::int64_t plane() const { return plane_; }  // floats from one channel of a line to the next

    std::uint64_t* closed_tiles() { return closed_tiles_.data(); }
    std::int64_t tile_rows() const { return volsplat::tile_rows(lines_); }
    std::int64_t tile_words() const { return volsplat::tile_words(line_pixels_); }  // of a row of tiles

private:
    const int width_, height_;
    bool turned_;
    int line_pixels_, lines_;
    std::int64_t plane_;
    LargeArray<float> memory_;  // of zeros, but for the lines that are not empty
    float* first_pixel_;
    std::vector<std::uint64_t> closed_tiles_;  // and one word more
};

}  // namespace volsplat
