// Threads that share out the stripes of an image.
#pragma once
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace volsplat {

class StripePool {
public:
    // As many threads work as told, the calling one among them. Throws std::system_error where one cannot be started.
    explicit StripePool(int threads);
    ~StripePool() { close(); }

    int threads() const { return static_cast<int>(helpers_.size()) + 1; }
    // Calls work(n) for each 0 <= n < count, each in whichever thread is free, and returns when all are done.
    // One thread at a time may call; `work` must not throw.
    void share_out(int count, const std::function<void(int)>& work);
    // Ends the helping threads.
    void close();

private:
    void help();
    void work_off(std::unique_lock<std::mutex>& lock);

    std::mutex mutex_;
    std::condition_variable begun_, done_;
    const std::function<void(int)>* work_ = nullptr;
    int next_ = 0, count_ = 0, unfinished_ = 0;
    bool closed_ = false;
    std::vector<std::thread> helpers_;
};

}  // namespace volsplat
