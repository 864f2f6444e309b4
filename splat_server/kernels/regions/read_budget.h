// How much may be buffered of a sender: beyond it, it is not read.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>

namespace volsplat {

class ReadBudget {
public:
    // `opened` is called by the thread that lets go of what was too much.
    ReadBudget(std::int64_t bytes, std::function<void()> opened) : bytes_(bytes), opened_(std::move(opened)) {}

    bool open() const { return held() < bytes_; }
    std::int64_t held() const { return held_.load(); }

private:
    friend class HeldMemory;
    void take(std::int64_t bytes) { held_ += bytes; }
    void give_back(std::int64_t bytes) {
        const std::int64_t before = held_.fetch_sub(bytes);
        if (before >= bytes_ && before - bytes < bytes_) opened_();
    }

    const std::int64_t bytes_;
    const std::function<void()> opened_;
    std::atomic<std::int64_t> held_{0};
};

// Memory that counts as buffered while it lives.
class HeldMemory {
public:
    HeldMemory(std::shared_ptr<const void> memory, std::shared_ptr<ReadBudget> budget, std::int64_t bytes)
        : memory_(std::move(memory)), budget_(std::move(budget)), bytes_(bytes) {
        budget_->take(bytes_);
    }
    ~HeldMemory() {
        memory_.reset();
        budget_->give_back(bytes_);
    }
    HeldMemory(const HeldMemory&) = delete;
    HeldMemory& operator=(const HeldMemory&) = delete;

private:
    std::shared_ptr<const void> memory_;
    const std::shared_ptr<ReadBudget> budget_;
    const std::int64_t bytes_;
};

}  // namespace volsplat
