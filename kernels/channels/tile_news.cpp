// Words of one frame never pass for another's: whoever hears them looks before and after of which frame they are.
#include "tile_news.h"

namespace volsplat {

namespace {

constexpr std::int64_t kNoFrame = -1;

}  // namespace

void TileNews::begin(std::int64_t frame, std::size_t first, std::size_t count) {
    if (count > kMostWords) count = 0;
    frame_.store(kNoFrame, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    for (std::size_t n = 0; n < count; ++n) words_[n].store(0, std::memory_order_relaxed);
    first_.store(first, std::memory_order_relaxed);
    count_.store(count, std::memory_order_relaxed);
    frame_.store(frame, std::memory_order_release);
}

void TileNews::tell(const std::uint64_t* words, std::size_t count) {
    if (count > kMostWords) return;
    for (std::size_t n = 0; n < count; ++n)
        words_[n].store(__atomic_load_n(words + n, __ATOMIC_RELAXED), std::memory_order_relaxed);
}

void TileNews::hear(std::int64_t frame, std::uint64_t* map, std::size_t words) const {
    if (frame_.load(std::memory_order_acquire) != frame) return;
    const std::uint64_t first = first_.load(std::memory_order_relaxed), count = count_.load(std::memory_order_relaxed);
    if (count > kMostWords || first > words || count > words - first) return;
    for (std::size_t n = 0; n < count; ++n) {
        const std::uint64_t closed = words_[n].load(std::memory_order_relaxed);
        if (closed == 0) continue;
        std::atomic_thread_fence(std::memory_order_acquire);
        if (frame_.load(std::memory_order_relaxed) != frame) return;
        __atomic_fetch_or(map + first + n, closed, __ATOMIC_RELAXED);
    }
}

}  // namespace volsplat
