// Keeps the memory of batches.
#include "batch.h"

#include <algorithm>
#include <atomic>
#include <mutex>

namespace volsplat {

std::uint64_t* ShadedPart::append(std::size_t more) {
    const std::size_t before = packet_count;
    packet_count += more;
    if (packets.size() < packet_count) packets.resize(std::max(packet_count, 2 * packets.size()));
    return packets.data() + before;
}

void Batch::begin(std::size_t regions) {
    parts.resize(regions);
    for (ShadedPart& part : parts) {
        part.runs.clear();
        part.packet_count = 0;
    }
    voxels_visited = 0;
}

std::size_t Batch::packet_count() const {
    std::size_t count = 0;
    for (const ShadedPart& part : parts) count += part.packet_count;
    return count;
}

std::shared_ptr<Batch> free_batch() {
    static std::mutex mutex;
    // Never freed: where the process ends in the middle of a frame, threads walk on while static objects are destroyed
    static auto& batches = *new std::vector<std::shared_ptr<Batch>>;
    constexpr std::size_t kKept = 64;
    const std::lock_guard locked(mutex);
    for (const auto& batch : batches) {
        if (batch.use_count() != 1) continue;
        std::atomic_thread_fence(std::memory_order_acquire);  // whoever let go of it has read it
        return batch;
    }
    const auto batch = std::make_shared<Batch>();
    if (batches.size() < kKept) batches.push_back(batch);
    return batch;
}

}  // namespace volsplat
