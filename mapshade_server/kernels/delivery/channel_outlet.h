// The way to a splat server of this machine: through a channel, without Python.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "mapshade_server/kernels/batches/batch_channel.h"
#include "outlet.h"
#include "still_wanted.h"

namespace volsplat {

struct SendSpan {  // one batch's, of which the end was waiting
    std::chrono::steady_clock::time_point began, waited, ended;
};

struct SendTally {
    std::int64_t bytes = 0;
    double seconds = 0, waiting_seconds = 0;  // of these, for the splat server
    std::vector<SendSpan> spans;
};

class ChannelOutlet : public Outlet {
public:
    // For the parts from `first` to before `end` of the frame's batches. Before each batch the tiles that the splat
    // server has closed are noted in `tiles`, so many words, if that is not null; it outlives this.
    ChannelOutlet(std::shared_ptr<BatchChannel> channel, std::int64_t frame, std::size_t first, std::size_t end,
                  std::uint64_t* tiles, std::size_t words, std::shared_ptr<const StillWanted> wanted);

    std::size_t most_packets() override;
    bool send(const std::shared_ptr<Batch>& batch) override;

    const SendTally& tally() const { return tally_; }

private:
    const std::shared_ptr<BatchChannel> channel_;
    const std::int64_t frame_;
    const std::size_t first_, end_;
    std::uint64_t* const tiles_;
    const std::size_t words_;
    const std::shared_ptr<const StillWanted> wanted_;
    SendTally tally_;
};

}  // namespace volsplat
