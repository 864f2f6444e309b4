#include "stripe_pool.h"

namespace volsplat {

StripePool::StripePool(int threads) {
    try {
        for (int n = 1; n < threads; ++n) helpers_.emplace_back([this] { help(); });
    } catch (...) {
        close();
        throw;
    }
}

void StripePool::share_out(int count, const std::function<void(int)>& work) {
    std::unique_lock lock(mutex_);
    work_ = &work, next_ = 0, count_ = unfinished_ = count;
    begun_.notify_all();
    work_off(lock);
    done_.wait(lock, [this] { return unfinished_ == 0; });
    count_ = 0;
}

void StripePool::close() {
    {
        const std::lock_guard lock(mutex_);
        closed_ = true;
        begun_.notify_all();
    }
    for (std::thread& helper : helpers_) helper.join();
    helpers_.clear();
}

void StripePool::help() {
    std::unique_lock lock(mutex_);
    while (true) {
        begun_.wait(lock, [this] { return closed_ || next_ < count_; });
        if (closed_) return;
        work_off(lock);
    }
}

void StripePool::work_off(std::unique_lock<std::mutex>& lock) {
    while (next_ < count_) {
        const int n = next_++;
        lock.unlock();
        (*work_)(n);
        lock.lock();
        if (--unfinished_ == 0) done_.notify_all();
    }
}

}  // namespace volsplat
