// How threads tell one another that there is something new to look at.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace volsplat {

// Whoever reads how often it has been rung before he looks, and then waits for once more, misses nothing.
class Bell {
public:
    void ring() {
        const std::lock_guard lock(mutex_);
        ++rung_;
        changed_.notify_all();
    }

    std::uint64_t rung() {
        const std::lock_guard lock(mutex_);
        return rung_;
    }

    // Waits until it has been rung more often than was heard. Returns how often.
    std::uint64_t wait(std::uint64_t heard) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return rung_ != heard; });
        return rung_;
    }

    // For so many seconds at most.
    std::uint64_t wait(std::uint64_t heard, double seconds) {
        std::unique_lock lock(mutex_);
        changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return rung_ != heard; });
        return rung_;
    }

private:
    std::mutex mutex_;
    std::condition_variable changed_;
    std::uint64_t rung_ = 0;
};

}  // namespace volsplat
