// Tells a map/shade server of this machine which tiles are closed.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>

#include "kernels/channels/batch_channels.h"
#include "splat_frame.h"

namespace volsplat {

// Any thread may call.
class TileTeller {
public:
    explicit TileTeller(std::shared_ptr<ChannelMemory> memory) : memory_(std::move(memory)) {}

    // From now on those of this frame; of none without one.
    void begin(std::int64_t frame, const std::shared_ptr<SplatFrame>& of);
    // Those that are closed now, but of a large map no more often than that pays.
    void tell();

private:
    const std::shared_ptr<ChannelMemory> memory_;
    std::mutex mutex_;                 // guards what follows, and what is told
    std::weak_ptr<SplatFrame> frame_;  // which may hold whoever tells
    std::chrono::steady_clock::time_point next_;
};

}  // namespace volsplat
