#include "splat_queue.h"

#include <algorithm>

#include "image_publishing.h"

namespace volsplat {

namespace {

// So many jobs may be unfinished: enough for stripes of unequal work, and little enough to be dropped soon.
constexpr std::size_t kMostUnfinished = 2;
// From so many pixels on it is worth to wake threads for publishing.
constexpr std::int64_t kSharedPixels = 1 << 16;

}  // namespace

SplatQueue::SplatQueue(ImageMemory& image, int threads) : image_(image), busy_lines_{0, image.lines()} {
    try {
        for (int n = 1; n < threads; ++n) helpers_.emplace_back([this] { help(); });
    } catch (...) {
        close();
        throw;
    }
}

void SplatQueue::begin(bool turned, RowSpan busy) {
    cancel();
    image_.clear(turned);
    busy_lines_ = busy;
    const std::lock_guard lock(mutex_);
    lines_.clear();
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
    StripedJob striped(job, lines_);
    lock.lock();
    help_until(kMostUnfinished - 1, lock);
    append({std::move(striped), nullptr, stripes_.size()}, began);
    return first_ + jobs_.size() - 1;
}

void SplatQueue::make_stripes(const SplatJob& job) {
    const int threads = static_cast<int>(helpers_.size()) + 1;
    lines_ = stripes_of(job.image.height, busy_lines_, job.footprint.height, threads);
    stripes_.assign(lines_.size(), {first_});
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
        image_.note(StripedJob(job, {{0, job.image.height}}).splat(0));
    } else {
        const StripedJob striped(job, lines_);
        for (std::size_t n = 0; n < lines_.size(); ++n) image_.note(striped.splat(n));
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
        help_until(0, lock);
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
    help_until(0, lock);
}

void SplatQueue::cancel() {
    std::unique_lock lock(mutex_);
    dropping_ = true;
    help_until(0, lock);
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

// By the caller, until no more than so many jobs are unfinished.
void SplatQueue::help_until(std::size_t jobs, std::unique_lock<std::mutex>& lock) {
    while (jobs_.size() > jobs) {
        if (Stripe* stripe = next_stripe()) do_next(*stripe, lock);
        else done_.wait(lock);
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
        const std::size_t number = &stripe - stripes_.data();
        const RowSpan lines = lines_[number];
        SplatOutcome outcome{lines.end, lines.begin, 0};
        if (job.splat) outcome = job.splat->splat(number);
        else hand_out(lines, job.target);
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
