// The image buffer's memory: associated float32, each row as four planes of red, green, blue and alpha, so that the
// splat loop combines neighbouring pixels without shuffling. Planes lie between margins that the loop may write to.
// Beside it, the map of closed tiles (protocol/closed_tiles.py).
#pragma once
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "large_memory.h"
#include "splat_job.h"

namespace volsplat {

class ImageMemory {
public:
    // Throws std::invalid_argument for a size outside 1..65535, std::bad_alloc where memory lacks.
    ImageMemory(int width, int height);

    // Empties image and map, and forgets what was hidden.
    void clear();
    // Says what a splat loop did.
    void note(const SplatOutcome& outcome);

    ImageView view();
    const float* row(int y) const { return first_pixel_ + y * 4 * plane_; }
    std::int64_t plane() const { return plane_; }  // floats from one channel of a row to the next
    int width() const { return width_; }
    int height() const { return height_; }
    // Rows outside of these are empty.
    int row_begin() const { return row_begin_; }
    int row_end() const { return row_end_; }

    std::uint64_t* closed_tiles() { return closed_tiles_.data(); }
    std::int64_t tile_rows() const { return tile_rows_; }
    std::int64_t tile_words() const { return tile_words_; }  // of a row of tiles
    std::uint64_t hidden_packets() const { return hidden_packets_; }

private:
    int width_, height_;
    std::int64_t plane_;
    LargeMemory memory_;
    float* first_pixel_;
    std::atomic<int> row_begin_, row_end_;  // read while another thread splats
    std::int64_t tile_rows_, tile_words_;
    std::vector<std::uint64_t> closed_tiles_;
    std::uint64_t hidden_packets_ = 0;
};

}  // namespace volsplat
