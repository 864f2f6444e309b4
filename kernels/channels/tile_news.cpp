// Words of one frame never pass for another's: whoever hears them looks before and after whether another has begun.
#include "tile_news.h"

namespace volsplat {

void TileNews::begin(std::int64_t frame, std::size_t first, std::size_t count) {
    if (count > kMostWords) count = 0;
    const std::uint64_t changes = changes_.load(std::memory_order_relaxed) | 1;
    changes_.store(changes, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    for (std::size_t n = 0; n < count; ++n) words_[n].store(0, std::memory_order_relaxed);
    frame_.store(frame, std::memory_order_relaxed);
    first_.store(first, std::memory_order_relaxed);
    count_.store(count, std::memory_order_relaxed);
    changes_.store(changes + 1, std::memory_order_release);
}

void TileNews::tell(const std::uint64_t* words, std::size_t count) {
    if (count > kMostWords) return;
    std::atomic_thread_fence(std::memory_order_release);  // after what another thread has begun
    for (std::size_t n = 0; n < count; ++n)
        words_[n].store(__atomic_load_n(words + n, __ATOMIC_RELAXED), std::memory_order_relaxed);
}

void TileNews::hear(std::int64_t frame, std::uint64_t* map, std::size_t words) const {
    const std::uint64_t changes = changes_.load(std::memory_order_acquire);
    if (changes % 2 != 0 || frame_.load(std::memory_order_relaxed) != frame) return;
    const std::uint64_t first = first_.load(std::memory_order_relaxed), count = count_.load(std::memory_order_relaxed);
    if (count > kMostWords || first > words || count > words - first) return;
    for (std::size_t n = 0; n < count; ++n) {
        const std::uint64_t closed = words_[n].load(std::memory_order_relaxed);
        if (closed == 0) continue;
        std::atomic_thread_fence(std::memory_order_acquire);
        if (changes_.load(std::memory_order_relaxed) != changes) return;
        __atomic_fetch_or(map + first + n, closed, __ATOMIC_RELAXED);
    }
}

}  // namespace volsplat
