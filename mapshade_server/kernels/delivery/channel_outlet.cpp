#include "channel_outlet.h"

#include <utility>

namespace volsplat {

namespace {

using Clock = std::chrono::steady_clock;

constexpr double kLookSeconds = 0.005;  // between two looks at whether the frame is still wanted

double seconds(Clock::duration duration) { return std::chrono::duration<double>(duration).count(); }

}  // namespace

ChannelOutlet::ChannelOutlet(std::shared_ptr<BatchChannel> channel, std::int64_t frame, std::size_t first,
                             std::size_t end, std::uint64_t* tiles, std::size_t words,
                             std::shared_ptr<const StillWanted> wanted)
    : channel_(std::move(channel)),
      frame_(frame),
      first_(first),
      end_(end),
      tiles_(tiles),
      words_(words),
      wanted_(std::move(wanted)) {}

std::size_t ChannelOutlet::most_packets() {
    if (tiles_) channel_->hear_tiles(frame_, tiles_, words_);
    return channel_->most_packets();
}

bool ChannelOutlet::send(const std::shared_ptr<Batch>& batch) {
    const Clock::time_point began = Clock::now();
    channel_->begin(frame_, batch, first_, end_);
    BatchChannel::Sent sent = channel_->send(0.0);
    const Clock::time_point full = Clock::now();
    while (sent == BatchChannel::Sent::part && (*wanted_)()) sent = channel_->send(kLookSeconds);
    if (sent == BatchChannel::Sent::lost) return false;
    const Clock::time_point ended = Clock::now();
    for (std::size_t n = first_; n < end_; ++n) {
        const ShadedPart& part = batch->parts[n];
        tally_.bytes += static_cast<std::int64_t>(PartCounts{part.runs.size(), part.packet_count}.bytes());
    }
    tally_.seconds += seconds(ended - began);
    tally_.waiting_seconds += seconds(ended - full);
    tally_.spans.push_back({began, full, ended});
    return true;
}

}  // namespace volsplat
