// One frame on its way: walkers send every splat server what reaches its regions.
//
// There are as many threads as walkers, but each thread takes the walker that is the furthest behind for one batch:
// regions wait for all walkers, and the system may keep one of the threads waiting for milliseconds.
//
// A splat server that is lost on the way gets no more; once all are, the frame is over. Each batch goes to all of them,
// if only to tell how far its walker has come: else two map/shade servers could each fill a splat server that waits for
// word of the other.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "crew.h"
#include "mapshade_server/kernels/batches/batch_walker.h"
#include "outlet.h"
#include "still_wanted.h"

namespace volsplat {

struct WalkSpan {  // one batch's
    std::chrono::steady_clock::time_point began, ended;
};

struct WalkTally {
    std::int64_t batches = 0, packets = 0, voxels = 0;
    double seconds = 0;
    std::vector<WalkSpan> spans;
};

class Delivery {
public:
    typedef std::vector<std::shared_ptr<Outlet>> Outlets;  // one for each splat server, null where that is lost before

    // Each walker with its outlets; the walkers outlive this. Throws std::invalid_argument unless these are alike.
    Delivery(const std::vector<BatchWalker*>& walkers, const std::vector<Outlets>& outlets,
             std::shared_ptr<StillWanted> wanted);

    // Walk and send, to the end or until it is of no use any more. Once. If a walker or an outlet throws, all others
    // are to end as well, and `on_failure` is called at once: they may be in sends that last until others hear of it.
    void run(Crew& crew, const std::function<void()>& on_failure);
    bool failed() const;
    // Rethrows what was thrown first. Once.
    void check();

    // Once it has ended.
    const WalkTally& tally(std::size_t walker) const { return ways_.at(walker).tally; }
    bool lost(std::size_t server) const { return lost_.at(server); }

private:
    struct Way {  // of a walker
        BatchWalker* walker;
        Outlets outlets;
        WalkTally tally{};
        bool taken = false;  // by a thread; for good once it has ended
        std::pair<std::int64_t, std::int64_t> reached{0, 0};
    };

    void walk();
    void fail(std::exception_ptr failure);
    Way* take_way();
    bool send_next(Way& way);
    bool goes_on() const;
    std::size_t most_packets(const Outlets& outlets) const;
    void lose(std::size_t server);

    const std::shared_ptr<StillWanted> wanted_;
    std::mutex taking_;  // guards what ways have of it
    std::vector<Way> ways_;
    std::vector<std::atomic<bool>> lost_;  // by splat server
    std::atomic<std::size_t> left_;        // of them
    mutable std::mutex failing_;           // guards the next
    std::exception_ptr failure_;
};

}  // namespace volsplat
