// Threads that walk a frame together, and wait for the next one.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace volsplat {

class Crew {
public:
    typedef std::function<void(std::size_t)> Job;

    Crew() = default;
    ~Crew();
    Crew(const Crew&) = delete;
    Crew& operator=(const Crew&) = delete;

    // Has the job done for each number below `count` at the same time, for 0 by the caller, and returns when all are
    // done. Rethrows a failure. One caller at a time. Throws std::system_error, with nothing done, if a thread cannot
    // be started.
    void run(std::size_t count, const Job& job);

private:
    void work(std::size_t number);
    void attempt(const Job& job, std::size_t number) noexcept;

    std::mutex mutex_;  // guards what follows
    std::condition_variable called_, all_done_;
    const Job* job_ = nullptr;
    std::size_t count_ = 0, unfinished_ = 0;
    std::uint64_t calls_ = 0;
    std::exception_ptr failure_;
    bool closed_ = false;

    std::vector<std::thread> threads_;  // the caller's
};

}  // namespace volsplat
