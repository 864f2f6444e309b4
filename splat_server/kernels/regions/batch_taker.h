// Takes the batches of a map/shade server of this machine out of its channels, and pushes them to the owners of
// regions.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "kernels/channels/batch_channels.h"
#include "splat_frame.h"
#include "tile_teller.h"

namespace volsplat {

struct TakenSpan {
    int walker;
    Clock::time_point began, ended;
};

// In a thread of its own. Nothing that comes is believed: it may be broken or hostile.
class BatchTaker {
public:
    // `news` rings if take_news() should be called.
    BatchTaker(std::shared_ptr<ChannelMemory> memory, std::shared_ptr<Bell> news);
    ~BatchTaker() { close(); }

    // Any thread.

    // From now on batches of this frame are its sources', of which the walkers have so many from the first on; those of
    // older frames are of no use any more, and those of later ones wait. Without a frame its batches are of no use.
    void begin(std::int64_t frame, std::shared_ptr<SplatFrame> into, int first_source, int walkers, bool traced);
    // Takes nothing any more, but for what drain() does.
    void close();
    // Takes what is there now.
    void drain();

    // Whether since the last call a fault was found, or there is a batch of a later frame than the one begun last.
    bool take_news() { return has_news_.exchange(false); }
    std::string fault();  // by which the map/shade server broke the rules; "": by none
    std::int64_t newest_frame() const { return newest_frame_; }  // that a batch has come of; -1: none
    std::int64_t bytes() const { return bytes_; }                // of the frame's batches
    std::vector<TakenSpan> spans();                              // of the frame, if it is traced

private:
    typedef std::vector<std::atomic<bool>> Flags;
    class TakenBlock;

    void work();
    bool take_any();
    bool take(int walker);
    void take_filled(int walker, int block, const BatchNote& note);
    void push(int walker, const BatchNote& note, const unsigned char* block, std::shared_ptr<const void> taken);
    std::unique_lock<std::mutex> locked();
    void look_at_newest();
    void fail(const char* fault) noexcept;

    const std::shared_ptr<ChannelMemory> memory_;
    const std::shared_ptr<Bell> news_;
    const std::shared_ptr<TileTeller> tiles_;
    const std::shared_ptr<Flags> taken_;  // of each block: what the memory says of that may be untrue
    std::atomic<bool> closed_{false}, has_news_{false};
    std::atomic<std::int64_t> newest_frame_{-1}, bytes_{0};

    std::mutex gate_;              // whoever waits for the next has it, so that the taker does not go before all others
    std::mutex mutex_;             // guards what follows
    std::vector<int> next_block_;  // of each walker
    std::vector<int> empty_;       // batches of the frame, of each walker
    std::string fault_;
    std::int64_t frame_ = -1;
    std::shared_ptr<SplatFrame> into_;
    int first_source_ = 0, walkers_ = 0;
    bool traced_ = false;
    std::vector<TakenSpan> spans_;

    std::mutex joining_;
    std::thread thread_;
};

}  // namespace volsplat
