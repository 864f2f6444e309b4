// Boxes of pixels that lie in closed tiles, found by moving rows of bits over each other.
#include "hidden_places.h"

#include <algorithm>
#include <array>

#include "kernels/tile_map.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"

namespace volsplat {

namespace {

constexpr std::int64_t kWordPixels = 32;
constexpr std::int64_t kWordsOfTiles = kTileSide * kWordTiles / kWordPixels;  // that one word of tiles makes
constexpr std::uint32_t kAllClosed = ~std::uint32_t{0};

// The pixels of eight tiles.
constexpr std::uint32_t pixels_of(std::uint64_t tiles) {
    static_assert(8 * kTileSide == kWordPixels);
    std::uint32_t pixels = 0;
    for (int tile = 0; tile < 8; ++tile) {
        pixels |= (tiles >> tile & 1 ? (1u << kTileSide) - 1 : 0) << tile * kTileSide;
    }
    return pixels;
}

constexpr std::array<std::uint32_t, 256> kPixelsOfTiles = [] {
    std::array<std::uint32_t, 256> pixels{};
    for (std::size_t tiles = 0; tiles < pixels.size(); ++tiles) pixels[tiles] = pixels_of(tiles);
    return pixels;
}();

// The most pixel centres within a reach on either side.
std::int64_t pixels_within(std::int64_t reach) { return 2 * reach / kPixel + 1; }

// Of a row of bits the word that begins `by` bits after word n. No sample changes what lies beyond the image.
std::uint32_t word_after(const std::uint32_t* row, std::int64_t words, std::int64_t n, std::int64_t by) {
    const std::int64_t first = n + by / kWordPixels, bits = by % kWordPixels;
    const std::uint32_t low = first < words ? row[first] : kAllClosed;
    const std::uint32_t high = first + 1 < words ? row[first + 1] : kAllClosed;
    return bits == 0 ? low : low >> bits | high << (kWordPixels - bits);
}

}  // namespace

HiddenPlaces::HiddenPlaces(const std::uint64_t* tiles, std::int64_t width, std::int64_t height, std::int64_t first_row,
                           const SampleReach& reach)
    : kernels_(map_shade_kernels()),
      tiles_(tiles),
      width_(width),
      height_(height),
      first_row_(first_row),
      tile_rows_(tile_rows(height)),
      tile_words_(tile_words(width)),
      reach_(reach),
      box_width_(std::min(pixels_within(reach.x), width)),
      box_height_(std::min(pixels_within(reach.y), height)),
      words_((width + kWordPixels - 1) / kWordPixels),
      hidden_(static_cast<std::size_t>(height * words_)),
      known_tiles_(static_cast<std::size_t>(tile_rows_ * tile_words_)),
      changed_(static_cast<std::size_t>(tile_rows_)),
      closed_(static_cast<std::size_t>(tile_rows_ * words_)),
      next_(static_cast<std::size_t>(words_)) {
    std::fill_n(closed_.begin(), first_row_ * words_, kAllClosed);
}

void HiddenPlaces::refresh() {
    const std::unique_lock locked(mutex_, std::try_to_lock);
    if (!locked) return;
    bool changed = false;
    for (std::int64_t row = first_row_; row < tile_rows_; ++row) {
        changed_[row] = take_over(row);
        if (changed_[row]) join_columns(row);
        changed |= changed_[row];
    }
    if (!changed) return;
    for (std::int64_t row = 0; row < tile_rows_; ++row) join_rows(row);
    any_.store(true, std::memory_order_relaxed);
}

VisibleVoxels HiddenPlaces::without_hidden(const RowLine& line, const VisibleVoxels& voxels, VoxelRoom& room) const {
    if (!any_.load(std::memory_order_relaxed)) return voxels;
    if (room.positions.size() < voxels.count + kSpare) {
        room.positions.resize(voxels.count + kSpare);
        room.packets.resize(voxels.count + kSpare);
    }
    const auto last = [](std::int64_t pixels) { return static_cast<std::int32_t>(pixels - 1); };
    const HiddenMap map{hidden_.data(), static_cast<std::int32_t>(words_), last(width_), last(height_)};
    const std::int64_t first_x = line.start_x - reach_.x + kPixel, first_y = line.start_y - reach_.y + kPixel;
    const std::size_t kept = kernels_.leave_out_hidden(voxels, map, {first_x, first_y, line.step_x, line.step_y},
                                                       room.positions.data(), room.packets.data());
    return {room.positions.data(), room.packets.data(), kept};
}

// Tells whether a row of tiles has changed.
bool HiddenPlaces::take_over(std::int64_t tile_row) {
    bool changed = false;
    const std::int64_t first = tile_row * tile_words_;
    for (std::int64_t n = first; n < first + tile_words_; ++n) {
        const std::uint64_t now = __atomic_load_n(tiles_ + n, __ATOMIC_RELAXED);
        changed |= now != known_tiles_[n];
        known_tiles_[n] = now;
    }
    return changed;
}

void HiddenPlaces::join_columns(std::int64_t tile_row) {
    const std::uint64_t* tiles = known_tiles_.data() + tile_row * tile_words_;
    std::uint32_t* closed = closed_.data() + tile_row * words_;
    for (std::int64_t n = 0; n < words_; ++n) {
        closed[n] = kPixelsOfTiles[tiles[n / kWordsOfTiles] >> n % kWordsOfTiles * 8 & 255];
    }
    if (width_ % kWordPixels != 0) closed[words_ - 1] |= kAllClosed << width_ % kWordPixels;
    for (std::int64_t joined = 1; joined < box_width_;) {
        const std::int64_t more = std::min(joined, box_width_ - joined);
        for (std::int64_t n = 0; n < words_; ++n) closed[n] &= word_after(closed, words_, n, more);
        joined += more;
    }
}

// Of the rows of pixels in a row of tiles. Their boxes end in one row of tiles, or in two that follow each other.
void HiddenPlaces::join_rows(std::int64_t tile_row) {
    const auto last_of_box = [&](std::int64_t row) { return std::min(height_ - 1, row + box_height_ - 1) / kTileSide; };
    const std::int64_t begin = tile_row * kTileSide, end = std::min(height_, begin + kTileSide);
    const std::int64_t least = last_of_box(begin), greatest = last_of_box(end - 1);
    const auto changed = changed_.begin();
    if (std::find(changed + tile_row, changed + greatest + 1, true) == changed + greatest + 1) return;

    std::copy_n(closed_.data() + tile_row * words_, words_, next_.data());
    for (std::int64_t other = tile_row + 1; other <= least; ++other) join_row(other, next_.data());
    for (std::int64_t row = begin; row < end; ++row) {
        if (row > begin && last_of_box(row) > last_of_box(row - 1)) join_row(greatest, next_.data());
        publish(row, next_.data());
    }
}

void HiddenPlaces::join_row(std::int64_t tile_row, std::uint32_t* hidden) const {
    const std::uint32_t* closed = closed_.data() + tile_row * words_;
    for (std::int64_t n = 0; n < words_; ++n) hidden[n] &= closed[n];
}

void HiddenPlaces::publish(std::int64_t row, const std::uint32_t* hidden) {
    std::uint32_t* words = hidden_.data() + row * words_;
    for (std::int64_t n = 0; n < words_; ++n) __atomic_store_n(words + n, hidden[n], __ATOMIC_RELAXED);
}

}  // namespace volsplat
