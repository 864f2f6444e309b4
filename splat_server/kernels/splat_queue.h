// Jobs splatted in their order, by threads that share out the stripes of an image: one stripe may be at the next job
// while another is still at this one, so that hardly a thread ever waits. Their number changes no bits.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "image_memory.h"
#include "stripes.h"

namespace volsplat {

// One thread at a time may call.
class SplatQueue {
public:
    // Into an image that outlives this. The caller is one of the threads: while it would wait, it splats.
    // Throws std::system_error where another cannot be started.
    SplatQueue(ImageMemory& image, int threads);
    ~SplatQueue() { close(); }

    // Drops what is unfinished, and clears the image. What follows mostly reaches the `busy` lines of it.
    void begin(bool turned, RowSpan busy);
    // Adds a job, which says what and how; its image is filled in here. What it points to must stay until it is
    // finished. Helps while several are unfinished; does a `small` one at once where none is. Returns its number.
    std::uint64_t add(SplatJob job, bool small);
    // Publishes the image as it is after all jobs, and empties it meanwhile: its lines are in the caches then.
    // `target` is height x width x 4.
    void hand_out(float* target);
    // Every job up to this number is finished or dropped.
    std::uint64_t finished();
    // Helps until all of them are.
    void finish();
    // Drops the jobs that are unfinished, and waits for the stripes that threads are at.
    void cancel();
    // Whether there is an unfinished job.
    bool busy();
    // For how long there has been an unfinished job, in all.
    double busy_seconds();
    // Ends the threads, and drops what is unfinished.
    void close();

private:
    typedef std::chrono::steady_clock Clock;

    struct Job {
        std::optional<StripedJob> splat;  // or else
        float* target;                    // to hand the image out to
        std::size_t unfinished;           // stripes
    };
    struct Stripe {
        std::uint64_t next;  // number of the job that it comes to next
        bool taken = false;
    };

    void make_stripes(const SplatJob& job);
    void splat_at_once(const SplatJob& job);
    void append(Job job, Clock::time_point began);
    void help();
    void help_until(std::size_t jobs, std::unique_lock<std::mutex>& lock);
    Stripe* next_stripe();
    void do_next(Stripe& stripe, std::unique_lock<std::mutex>& lock);
    void hand_out(RowSpan lines, float* target);
    void retire();

    ImageMemory& image_;
    RowSpan busy_lines_;
    std::vector<std::thread> helpers_;

    std::mutex mutex_;  // guards what follows, but where nothing is unfinished
    std::condition_variable added_, done_;
    std::deque<Job> jobs_;        // unfinished ones
    std::uint64_t first_ = 1;     // number of the first of them
    std::vector<RowSpan> lines_;  // of the stripes, which are made for an image's first job
    std::vector<Stripe> stripes_;
    bool dropping_ = false, closed_ = false;
    Clock::time_point busy_since_, idle_since_;
    Clock::duration busy_{};
};

}  // namespace volsplat
