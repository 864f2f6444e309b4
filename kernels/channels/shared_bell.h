// How a thread of one process tells a thread of another that there is something new, in memory that both see.
#pragma once

#include <atomic>
#include <chrono>
#include <climits>
#include <cstdint>
#include <thread>

#ifdef __linux__
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <ctime>
#endif

namespace volsplat {

// Like Bell: whoever reads how often it was rung before looking, and then waits for once more, misses nothing.
// Zeros are one that was never rung. The other process may write what it likes: no wait is longer than it was asked
// for.
class SharedBell {
public:
    void ring() {
        ++rung_;
        if (waiting_ != 0) wake();  // else whoever begins to wait now finds that it was rung
    }

    // Also where the other process may have spoilt what says who waits.
    void ring_anyway() {
        ++rung_;
        wake();
    }

    std::uint32_t rung() const { return rung_; }

    // Until it has been rung more often than was heard, and for so many seconds at most. It may return early.
    void wait(std::uint32_t heard, double seconds) {
        ++waiting_;
        if (rung_ == heard) sleep(heard, seconds);
        --waiting_;
    }

private:
    void wake() {
#ifdef __linux__
        ::syscall(SYS_futex, &rung_, FUTEX_WAKE, INT_MAX, nullptr, nullptr, 0);
#endif
    }

    void sleep([[maybe_unused]] std::uint32_t heard, double seconds) {
#ifdef __linux__
        const auto whole = static_cast<std::time_t>(seconds);
        const std::timespec limit{whole, static_cast<long>((seconds - static_cast<double>(whole)) * 1e9)};
        ::syscall(SYS_futex, &rung_, FUTEX_WAIT, heard, &limit, nullptr, 0);
#else
        std::this_thread::sleep_for(std::chrono::duration<double>(seconds < 1e-3 ? seconds : 1e-3));
#endif
    }

    std::atomic<std::uint32_t> rung_, waiting_;
};
static_assert(sizeof(SharedBell) == 8 && std::atomic<std::uint32_t>::is_always_lock_free);

}  // namespace volsplat
