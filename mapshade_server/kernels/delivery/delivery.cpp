#include "delivery.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

namespace volsplat {

namespace {

std::size_t servers_of(const std::vector<BatchWalker*>& walkers, const std::vector<Delivery::Outlets>& outlets) {
    if (walkers.empty() || outlets.size() != walkers.size())
        throw std::invalid_argument("a frame has walkers, and each of them outlets");
    const std::size_t servers = outlets[0].size();
    for (const Delivery::Outlets& one : outlets)
        if (one.size() != servers) throw std::invalid_argument("walkers have an outlet for each splat server");
    return servers;
}

}  // namespace

Delivery::Delivery(const std::vector<BatchWalker*>& walkers, const std::vector<Outlets>& outlets,
                   std::shared_ptr<StillWanted> wanted)
    : wanted_(std::move(wanted)), lost_(servers_of(walkers, outlets)), left_(lost_.size()) {
    for (std::size_t n = 0; n < walkers.size(); ++n) ways_.push_back({walkers[n], outlets[n]});
    for (std::size_t server = 0; server < lost_.size(); ++server)
        if (!outlets[0][server]) lose(server);
}

void Delivery::run(Crew& crew, const std::function<void()>& on_failure) {
    crew.run(ways_.size(), [&](std::size_t) {
        try {
            walk();
        } catch (...) {
            fail(std::current_exception());
            on_failure();
        }
    });
}

void Delivery::fail(std::exception_ptr failure) {
    wanted_->end();
    const std::lock_guard lock(failing_);
    if (!failure_) failure_ = std::move(failure);
}

bool Delivery::failed() const {
    const std::lock_guard lock(failing_);
    return failure_ != nullptr;
}

void Delivery::check() {
    std::exception_ptr failure;
    {
        const std::lock_guard lock(failing_);
        failure = failure_;
    }
    if (failure) std::rethrow_exception(failure);
}

void Delivery::walk() {
    while (Way* const way = take_way()) {
        const bool last = send_next(*way);
        const std::lock_guard lock(taking_);
        way->taken = last;
    }
}

// The one that is the furthest behind. None once all are others' or have ended.
Delivery::Way* Delivery::take_way() {
    if (!goes_on()) return nullptr;
    const std::lock_guard lock(taking_);
    Way* behind = nullptr;
    for (Way& way : ways_)
        if (!way.taken && (!behind || way.reached < behind->reached)) behind = &way;
    if (behind) behind->taken = true;
    return behind;
}

// Whether that was the last batch.
bool Delivery::send_next(Way& way) {
    const std::size_t most = most_packets(way.outlets);
    const auto began = std::chrono::steady_clock::now();
    const std::shared_ptr<Batch> batch = free_batch();
    way.walker->next_batch(most, *batch);
    const auto ended = std::chrono::steady_clock::now();
    ++way.tally.batches;
    way.tally.packets += static_cast<std::int64_t>(batch->packet_count());
    way.tally.voxels += batch->voxels_visited;
    way.tally.seconds += std::chrono::duration<double>(ended - began).count();
    way.tally.spans.push_back({began, ended});
    way.reached = {batch->reached_sheet, batch->reached_row};
    for (std::size_t server = 0; server < way.outlets.size(); ++server)
        if (!lost_[server] && !way.outlets[server]->send(batch)) lose(server);
    return batch->last;
}

bool Delivery::goes_on() const { return left_ != 0 && (*wanted_)(); }

std::size_t Delivery::most_packets(const Outlets& outlets) const {
    std::size_t most = std::numeric_limits<std::size_t>::max();
    for (std::size_t server = 0; server < outlets.size(); ++server)
        if (!lost_[server]) most = std::min(most, outlets[server]->most_packets());
    return most;
}

void Delivery::lose(std::size_t server) {
    if (!lost_[server].exchange(true)) --left_;
}

}  // namespace volsplat
