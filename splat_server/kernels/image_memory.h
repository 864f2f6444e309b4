// The image buffer's memory: associated float32, each line of pixels as four planes of red, green, blue and alpha, so
// that the splat loop combines neighbouring pixels without shuffling. Planes lie between margins that the loop may
// write to. Lines are the image's rows or, where runs of samples go up and down, its columns: then the pixels of a run
// lie in few lines, which the first cache can hold. Beside it, the map of closed tiles
// (protocol/rules/closed_tiles.py).
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/large_memory.h"
#include "splat_job.h"

namespace volsplat {

constexpr std::int64_t kLinePixels = 64 / sizeof(float);  // of a cache line, for one channel

class ImageMemory {
public:
    // Kept by rows. Throws std::invalid_argument for a size outside 1..65535, std::bad_alloc where memory lacks.
    ImageMemory(int width, int height);

    // Empties image and map, and forgets what was hidden. From then on lines are rows or columns.
    void clear(bool by_columns);
    // Empties some lines; map and count stay as they are.
    void empty(RowSpan lines);
    // All lines have been emptied.
    void note_empty() { line_begin_ = lines_, line_end_ = 0; }
    // A splat loop has done this.
    void note(const SplatOutcome& outcome);

    ImageView view();
    int width() const { return width_; }
    int height() const { return height_; }
    bool by_columns() const { return by_columns_; }
    int lines() const { return lines_; }
    const float* line(int n) const { return first_pixel_ + n * 4 * plane_; }
    std::int64_t plane() const { return plane_; }  // floats from one channel of a line to the next
    // Lines outside of these are empty.
    int line_begin() const { return line_begin_; }
    int line_end() const { return line_end_; }

    // By rows, whatever lines are.
    std::uint64_t* closed_tiles() { return tiles_by_rows_.words.data(); }
    std::int64_t tile_rows() const { return tiles_by_rows_.rows; }
    std::int64_t tile_words() const { return tiles_by_rows_.row_words; }  // of a row of tiles
    std::uint64_t hidden_packets() const { return hidden_packets_; }

private:
    struct TileMap {
        TileMap(int width, int height);
        std::int64_t rows, row_words;
        std::vector<std::uint64_t> words;  // and one more
    };

    void lay_out(bool by_columns);

    const int width_, height_;
    bool by_columns_;
    int line_pixels_, lines_;
    std::int64_t plane_;
    LargeArray<float> memory_;  // of zeros, but for the lines that are not empty
    float* first_pixel_;
    std::atomic<int> line_begin_, line_end_;  // read while another thread splats
    TileMap tiles_by_rows_, tiles_by_columns_;
    std::atomic<std::uint64_t> hidden_packets_{0};
};

}  // namespace volsplat
