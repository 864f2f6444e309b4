#include "region.h"

#include <algorithm>
#include <utility>

#include "splat_server/kernels/paths/splat_kernels.h"

namespace volsplat {

Region::Region(ImageMemory& image, const SplatJob& job, int sources, const EdgeLayers& layers)
    : image_(image),
      job_(job),
      planes_(job.slabs ? std::make_unique<SlabPlanes>(*job.slabs, job) : nullptr),
      layers_(layers),
      buffers_(sources),
      drawn_begin_(job.row_end),
      drawn_end_(job.row_begin) {}

void Region::drop() {
    if (!published_) image_.empty(drawn());
}

void Region::let_go() {
    {
        const std::lock_guard lock(inbox_mutex_);
        inbox_.clear();
    }
    arrived_.clear();
    spans_.clear();
    spent_.clear();
    buffers_ = SortedBuffers(0);
}

bool Region::put(Arrival arrival) {
    const std::lock_guard lock(inbox_mutex_);
    const bool awaited = awaited_ == arrival.source;
    if (awaited) awaited_ = -1;
    inbox_.push_back(std::move(arrival));
    return awaited;
}

bool Region::advance(std::uint64_t max_packets, OwnerRecord& record) {
    const std::uint64_t packets = merge(max_packets, record);
    if (packets) {
        const Stopwatch watch(record, kSplatting);
        splat();
        spans_.clear();
        spent_.clear();
        packets_ += packets;
    }
    reached_ = place();
    return packets > 0;
}

Place Region::place() const {
    if (buffers_.complete()) return kEnd;
    const MergeKey& key = buffers_.reached();
    return {static_cast<std::uint32_t>(key.row), static_cast<std::uint32_t>(key.sheet)};
}

std::uint64_t Region::merge(std::uint64_t max_packets, OwnerRecord& record) {
    const Stopwatch watch(record, kMerging);
    {
        const std::lock_guard lock(inbox_mutex_);
        arrived_.swap(inbox_);
    }
    for (Arrival& arrival : arrived_) buffers_.push(std::move(arrival));
    arrived_.clear();
    return buffers_.advance(max_packets, spans_, spent_);
}

void Region::splat() {
    if (job_.row_begin == job_.row_end) return;
    if (planes_) {
        drawn_begin_ = job_.row_begin, drawn_end_ = job_.row_end;
        hidden_packets_ += planes_->add(spans_.data(), spans_.size());
        return;
    }
    job_.spans = spans_.data(), job_.span_count = spans_.size();
    const SplatOutcome outcome = splat_kernels().splat(job_);
    job_.unseen_pixels = outcome.unseen_pixels;
    drawn_begin_ = std::min(drawn_begin_.load(), outcome.row_begin);
    drawn_end_ = std::max(drawn_end_.load(), outcome.row_end);
    hidden_packets_ += outcome.hidden;
}

bool Region::wait() {
    const std::lock_guard lock(inbox_mutex_);
    if (!inbox_.empty()) return false;
    awaited_ = buffers_.waits_for();
    return true;
}

void Region::publish(const PixelBlock& target) {
    if (planes_) planes_->finish();
    const std::lock_guard lock(showing_);
    publish_to(target);
    image_.empty(drawn());
    published_ = true;
}

void Region::show(const PixelBlock& published, const PixelBlock& target) {
    const std::lock_guard lock(showing_);
    if (published_) copy_pixels(published, rectangle_of(image_, lines()), target);
    else publish_to(target);
}

void Region::publish_to(const PixelBlock& target) const {
    publish_lines(image_, lines(), drawn(), target);
    if (layers_.front) lay_between(*layers_.front, *layers_.behind, rectangle_of(image_, lines()), target);
}

}  // namespace volsplat
