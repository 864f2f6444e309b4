#include "tile_teller.h"

namespace volsplat {

void TileTeller::begin(std::int64_t frame, const std::shared_ptr<SplatFrame>& of) {
    const TileWords closed = of ? of->closed_tiles() : TileWords{};
    const std::lock_guard lock(mutex_);
    frame_ = of;
    memory_->tile_news().begin(frame, closed.first, closed.count);
}

void TileTeller::tell() {
    std::shared_ptr<SplatFrame> frame;  // if this lets go of the last, the mutex is free by then
    const std::lock_guard lock(mutex_);
    frame = frame_.lock();
    if (!frame) return;
    const TileWords closed = frame->closed_tiles();
    memory_->tile_news().tell(closed.words, closed.count);
}

}  // namespace volsplat
