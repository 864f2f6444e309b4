#include "tile_teller.h"

namespace volsplat {

namespace {

// Telling all of a map costs a nanosecond a word, and owners wait for each other in it: they do so seldom if it is
// large.
constexpr std::size_t kLargeMap = 4096;  // words
constexpr std::chrono::nanoseconds kPauseOfAWord{20};

}  // namespace

void TileTeller::begin(std::int64_t frame, const std::shared_ptr<SplatFrame>& of) {
    const TileWords closed = of ? of->closed_tiles() : TileWords{};
    const std::lock_guard lock(mutex_);
    frame_ = of;
    next_ = {};
    memory_->tile_news().begin(frame, closed.first, closed.count);
}

void TileTeller::tell() {
    std::shared_ptr<SplatFrame> frame;  // if this lets go of the last, the mutex is free by then
    const std::lock_guard lock(mutex_);
    frame = frame_.lock();
    if (!frame) return;
    const TileWords closed = frame->closed_tiles();
    if (closed.count >= kLargeMap) {
        const auto now = std::chrono::steady_clock::now();
        if (now < next_) return;
        next_ = now + closed.count * kPauseOfAWord;
    }
    memory_->tile_news().tell(closed.words, closed.count);
}

}  // namespace volsplat
