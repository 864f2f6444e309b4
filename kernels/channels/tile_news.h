// Which tiles of an image are closed (protocol/rules/closed_tiles.py), told by a splat server to a map/shade server of
// its machine.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace volsplat {

// In memory that both see; zeros tell nothing. Words are those of the image's map.
class TileNews {
public:
    static constexpr std::size_t kMostWords = 1 << 18;  // of 16384 x 16384 pixels

    // For the splat server, one thread at a time.

    // None of so many words of a frame's map, from the first on, has a tile closed. Nothing is told of more than
    // kMostWords.
    void begin(std::int64_t frame, std::size_t first, std::size_t count);
    // These so many are as the words are, which others may write meanwhile. What the memory says itself is not
    // believed.
    void tell(const std::uint64_t* words, std::size_t count);

    // For the map/shade server, any thread: adds the tiles that are closed to a map of so many words, if that is of
    // this frame.
    void hear(std::int64_t frame, std::uint64_t* map, std::size_t words) const;

private:
    std::atomic<std::uint64_t> changes_;  // odd while it begins
    std::atomic<std::int64_t> frame_;
    std::atomic<std::uint64_t> first_, count_;
    std::atomic<std::uint64_t> words_[kMostWords];
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

}  // namespace volsplat
