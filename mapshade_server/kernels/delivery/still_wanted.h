// Whether a frame is still of use.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>

namespace volsplat {

typedef std::atomic<std::int64_t> NewestFrame;  // its number

// Any thread may ask, and end it.
class StillWanted {
public:
    StillWanted(std::shared_ptr<const NewestFrame> newest, std::int64_t frame)
        : newest_(std::move(newest)), frame_(frame) {}

    bool operator()() const { return !ended_ && *newest_ <= frame_; }
    void end() { ended_ = true; }

private:
    const std::shared_ptr<const NewestFrame> newest_;
    const std::int64_t frame_;
    std::atomic<bool> ended_{false};
};

}  // namespace volsplat
