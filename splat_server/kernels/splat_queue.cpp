#include "splat_queue.h"

#include <algorithm>

#include "image_publishing.h"
#include "splat.h"

namespace volsplat {
namespace {

// So many jobs may be unfinished: enough for stripes of unequal work, and little enough to be dropped soon.
constexpr std::size_t kMostUnfinished = 3;
// From so many pixels on it is worth to wake threads for publishing.
constexpr std::int64_t kSharedPixels = 1 << 16;

}  // namespace

SplatQueue::SplatQueue(ImageMemory& image, int threads) : image_(image), busy_lines_{0, image.lines()} {
    try {
        for (int n = 0; n < threads && threads > 1; ++n) helpers_.emplace_back([this] { help(); });
    } catch (...) {
        close();
        throw;
    }
}

void SplatQueue::begin(bool by_columns, RowSpan busy) {
    cancel();
    image_.clear(by_columns);
    busy_lines_ = busy;
    const std::lock_guard lock(mutex_);
    stripes_.clear();
}

std::uint64_t SplatQueue::add(SplatJob job, bool small) {
    const Clock::time_point began = Clock::now();
    job.image = image_.view();
    std::unique_lock lock(mutex_);
    if (stripes_.empty()) make_stripes(job);
    if (jobs_.empty() && (small || helpers_.empty())) {
        lock.unlock();
        splat_at_once(job);
        return first_ - 1;
    }
    lock.unlock();
    StripedJob striped(job, static_cast<int>(stripes_.size()));
    lock.lock();
    done_.wait(lock, [this] { return jobs_.size() < kMostUnfinished; });
    append({std::move(striped), nullptr, stripes_.size()}, began);
    return first_ + jobs_.size() - 1;
}

void SplatQueue::make_stripes(const SplatJob& job) {
    const int threads = std::max(static_cast<int>(helpers_.size()), 1);
    std::vector<Stripe> stripes;
    for (const RowSpan& lines : stripes_of(job.image.height, busy_lines_, job.footprint.height, threads))
        stripes.push_back({lines, first_});
    stripes_.swap(stripes);
}

// With the lock held.
void SplatQueue::append(Job job, Clock::time_point began) {
    if (jobs_.empty()) busy_since_ = std::max(began, idle_since_);
    jobs_.push_back(std::move(job));
    added_.notify_all();
}

// By the caller, with nothing unfinished.
void SplatQueue::splat_at_once(const SplatJob& job) {
    const Clock::time_point began = Clock::now();
    if (!helpers_.empty()) {
        image_.note(StripedJob(job, 1).splat({0, job.image.height}));
    } else {
        const StripedJob striped(job, static_cast<int>(stripes_.size()));
        for (const Stripe& stripe : stripes_) image_.note(striped.splat(stripe.lines));
    }
    busy_ += Clock::now() - began;
}

// Each stripe as soon as it is through with its jobs.
void SplatQueue::hand_out(float* target) {
    const Clock::time_point began = Clock::now();
    std::unique_lock lock(mutex_);
    const bool large = std::int64_t(image_.width()) * image_.height() >= kSharedPixels;
    if (!helpers_.empty() && !stripes_.empty() && (large || !jobs_.empty())) {
        append({std::nullopt, target, stripes_.size()}, began);
        done_.wait(lock, [this] { return jobs_.empty(); });
    } else {
        hand_out({0, image_.lines()}, target);
        busy_ += Clock::now() - began;
    }
    image_.note_empty();
}

std::uint64_t SplatQueue::finished() {
    const std::lock_guard lock(mutex_);
    return first_ - 1;
}

void SplatQueue::finish() {
    std::unique_lock lock(mutex_);
    done_.wait(lock, [this] { return jobs_.empty(); });
}

void SplatQueue::cancel() {
    std::unique_lock lock(mutex_);
    dropping_ = true;
    done_.wait(lock, [this] { return jobs_.empty(); });
    dropping_ = false;
}

bool SplatQueue::busy() {
    const std::lock_guard lock(mutex_);
    return !jobs_.empty();
}

double SplatQueue::busy_seconds() {
    const std::lock_guard lock(mutex_);
    const Clock::duration now = jobs_.empty() ? Clock::duration{} : Clock::now() - busy_since_;
    return std::chrono::duration<double>(busy_ + now).count();
}

void SplatQueue::close() {
    if (!helpers_.empty()) cancel();
    {
        const std::lock_guard lock(mutex_);
        closed_ = true;
        added_.notify_all();
    }
    for (std::thread& helper : helpers_) helper.join();
    helpers_.clear();
}

void SplatQueue::help() {
    std::unique_lock lock(mutex_);
    while (true) {
        Stripe* stripe = nullptr;
        added_.wait(lock, [&] { return closed_ || (stripe = next_stripe()); });
        if (closed_) return;
        do_next(*stripe, lock);
    }
}

// The one that is furthest behind of those that no thread is at.
SplatQueue::Stripe* SplatQueue::next_stripe() {
    Stripe* next = nullptr;
    for (Stripe& stripe : stripes_)
        if (!stripe.taken && stripe.next < first_ + jobs_.size() && (!next || stripe.next < next->next)) next = &stripe;
    return next;
}

void SplatQueue::do_next(Stripe& stripe, std::unique_lock<std::mutex>& lock) {
    Job& job = jobs_[stripe.next - first_];
    if (!dropping_) {
        stripe.taken = true;
        lock.unlock();
        SplatOutcome outcome{stripe.lines.end, stripe.lines.begin, 0};
        if (job.splat) outcome = job.splat->splat(stripe.lines);
        else hand_out(stripe.lines, job.target);
        lock.lock();
        stripe.taken = false;
        image_.note(outcome);
    }
    ++stripe.next;
    if (--job.unfinished == 0) retire();
}

void SplatQueue::hand_out(RowSpan lines, float* target) {
    publish_lines(image_, lines, target);
    image_.empty(lines);
}

// Always the first job: stripes pass jobs in their order, so none ends before those in front of it.
void SplatQueue::retire() {
    jobs_.pop_front();
    ++first_;
    if (jobs_.empty()) {
        idle_since_ = Clock::now();
        busy_ += idle_since_ - busy_since_;
    }
    done_.notify_all();
}

}  // namespace volsplat
