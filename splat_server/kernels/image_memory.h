// The image buffer's memory: associated float32, each line of pixels as four planes of red, green, blue and alpha, so
// that the splat loop combines neighbouring pixels without shuffling. Planes lie between margins that the loop may
// write to. Lines are the rows of the image or, where its frame is planned with x and y exchanged, its columns: they
// become rows when it is published. Beside it, the map of closed tiles (protocol/rules/closed_tiles.py), by lines.
#pragma once

#include <atomic>
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

    // Empties image and map, and forgets what was hidden. From then on lines are rows or, `turned`, columns.
    void clear(bool turned);
    // Empties some lines; map and count stay as they are.
    void empty(RowSpan lines);
    // All lines have been emptied.
    void note_empty() { line_begin_ = lines_, line_end_ = 0; }
    // A splat loop has done this.
    void note(const SplatOutcome& outcome);

    ImageView view();
    int width() const { return width_; }
    int height() const { return height_; }
    bool turned() const { return turned_; }
    int lines() const { return lines_; }
    const float* line(int n) const { return first_pixel_ + n * 4 * plane_; }
    std::int64_t plane() const { return plane_; }  // floats from one channel of a line to the next
    // Lines outside of these are empty.
    int line_begin() const { return line_begin_; }
    int line_end() const { return line_end_; }

    std::uint64_t* closed_tiles() { return closed_tiles_.data(); }
    std::int64_t tile_rows() const { return volsplat::tile_rows(lines_); }
    std::int64_t tile_words() const { return volsplat::tile_words(line_pixels_); }  // of a row of tiles
    std::uint64_t hidden_packets() const { return hidden_packets_; }

private:
    void lay_out(bool turned);

    const int width_, height_;
    bool turned_;
    int line_pixels_, lines_;
    std::int64_t plane_;
    LargeArray<float> memory_;  // of zeros, but for the lines that are not empty
    float* first_pixel_;
    std::atomic<int> line_begin_, line_end_;   // read while another thread splats
    std::vector<std::uint64_t> closed_tiles_;  // and one word more
    std::atomic<std::uint64_t> hidden_packets_{0};
};

}  // namespace volsplat
