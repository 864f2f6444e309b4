// Calls the threads of a crew.
#include "crew.h"

#include <utility>

namespace volsplat {

Crew::~Crew() {
    {
        const std::lock_guard lock(mutex_);
        closed_ = true;
    }
    called_.notify_all();
    for (std::thread& thread : threads_) thread.join();
}

void Crew::run(std::size_t count, const Job& job) {
    while (threads_.size() + 1 < count) threads_.emplace_back([this, number = threads_.size() + 1] { work(number); });
    {
        const std::lock_guard lock(mutex_);
        job_ = &job, count_ = count, unfinished_ = count - 1, failure_ = nullptr;
        ++calls_;
    }
    if (count > 1) called_.notify_all();
    attempt(job, 0);
    std::unique_lock lock(mutex_);
    all_done_.wait(lock, [this] { return unfinished_ == 0; });
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void Crew::work(std::size_t number) {
    std::uint64_t heard = 0;
    std::unique_lock lock(mutex_);
    while (true) {
        called_.wait(lock, [&] { return closed_ || (calls_ != heard && unfinished_ != 0); });
        if (closed_) return;
        heard = calls_;
        if (number >= count_) continue;
        const Job& job = *job_;
        lock.unlock();
        attempt(job, number);
        lock.lock();
        if (--unfinished_ == 0) all_done_.notify_one();
    }
}

void Crew::attempt(const Job& job, std::size_t number) noexcept {
    try {
        job(number);
    } catch (...) {
        const std::lock_guard lock(mutex_);
        if (!failure_) failure_ = std::current_exception();
    }
}

}  // namespace volsplat
