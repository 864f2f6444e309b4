// A region: a band of the image's lines, with its own sorted list of buffers. One thread, its owner, merges, splats and
// publishes it; any thread brings what sources have handed out for it.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "merge.h"
#include "slab_planes.h"
#include "splat_server/kernels/image_memory.h"
#include "splat_server/kernels/image_publishing.h"

namespace volsplat {

struct EdgeLayers {  // none, or both
    const EdgeLayer *front, *behind;
};

struct OwnerSeconds {
    double merge = 0, splat = 0, walk = 0;
    SlabSeconds slabs;  // of splat, in frames of slabs
};

struct Stage {
    const char* name;
    double OwnerSeconds::* seconds;
};

constexpr Stage kMerging{"merge", &OwnerSeconds::merge};
constexpr Stage kSplatting{"splat", &OwnerSeconds::splat};
constexpr Stage kWalking{"walk", &OwnerSeconds::walk};

typedef std::chrono::steady_clock Clock;

struct OwnerSpan {
    const char* stage;
    Clock::time_point began, ended;
};

struct OwnerRecord {  // what an owner has done
    OwnerSeconds seconds;
    bool traced = false;
    std::vector<OwnerSpan> spans;  // if it is traced
};

class Stopwatch {  // records its life as a stage
public:
    Stopwatch(OwnerRecord& record, const Stage& stage) : record_(record), stage_(stage), began_(Clock::now()) {}
    ~Stopwatch() {
        const Clock::time_point ended = Clock::now();
        record_.seconds.*stage_.seconds += std::chrono::duration<double>(ended - began_).count();
        if (record_.traced) record_.spans.push_back({stage_.name, began_, ended});
    }
    Stopwatch(const Stopwatch&) = delete;
    Stopwatch& operator=(const Stopwatch&) = delete;

private:
    OwnerRecord& record_;
    const Stage& stage_;
    const Clock::time_point began_;
};

// A row of a sheet, in one word so that any thread may read it while its owner goes on.
struct alignas(8) Place {  // so that Clang stores it at once, and calls no library for it
    std::uint32_t row, sheet;
    auto operator<=>(const Place& other) const { return std::pair(sheet, row) <=> std::pair(other.sheet, other.row); }
    bool operator==(const Place&) const = default;
};

constexpr Place kEnd{~0u, ~0u};

class Region {
public:
    // The image outlives it, and what the job points to. The job says what is splatted, and into which lines.
    Region(ImageMemory& image, const SplatJob& job, int sources, const EdgeLayers& layers);
    RowSpan lines() const { return {job_.row_begin, job_.row_end}; }

    // True if its owner waits for this source.
    bool put(Arrival arrival);
    // The source that its owner waits for; -1 if it does not.
    int awaited() const { return awaited_.load(); }

    // For its owner: merges and splats about so many packets. False if nothing is decided: it is complete, or waits.
    bool advance(std::uint64_t max_packets, OwnerRecord& record);
    // For its owner, who has found nothing decided. False if something has arrived since.
    bool wait();
    bool complete() const { return buffers_.complete(); }
    // For its owner, once it is complete: from then on it stands in the block, and its lines are empty.
    void publish(const PixelBlock& target);
    bool published() const { return published_.load(); }
    // For its owner, once it is published.
    SlabSeconds slab_seconds() const { return planes_ ? planes_->seconds() : SlabSeconds{}; }
    // All that lies before this place of the traversal has been splatted.
    Place reached() const { return reached_.load(); }

    // Once its owner is at it no more: empties what was not published.
    void drop();
    // Once its owner is at it no more and nothing comes: lets go of what was not splatted.
    void let_go();

    // Any thread: the region as it stands, into another block than the one that it is published to.
    void show(const PixelBlock& published, const PixelBlock& target);

    std::uint64_t packets() const { return packets_.load(); }
    std::uint64_t hidden_packets() const { return hidden_packets_.load(); }

private:
    std::uint64_t merge(std::uint64_t max_packets, OwnerRecord& record);
    void splat();
    Place place() const;
    void publish_to(const PixelBlock& target) const;
    RowSpan drawn() const { return {drawn_begin_.load(), drawn_end_.load()}; }

    ImageMemory& image_;
    SplatJob job_;
    const std::unique_ptr<SlabPlanes> planes_;  // in frames of slabs
    const EdgeLayers layers_;

    std::mutex inbox_mutex_;  // guards the next
    std::vector<Arrival> inbox_;
    std::atomic<int> awaited_{-1};  // written with the mutex

    // Its owner's
    SortedBuffers buffers_;
    std::vector<Arrival> arrived_;
    std::vector<SpanView> spans_;
    std::vector<std::shared_ptr<const void>> spent_;

    std::atomic<int> drawn_begin_, drawn_end_;  // lines outside of these are empty
    std::atomic<std::uint64_t> packets_{0}, hidden_packets_{0};
    std::atomic<Place> reached_{Place{0, 0}};
    std::mutex showing_;  // its lines must not be emptied meanwhile
    std::atomic<bool> published_{false};
};

}  // namespace volsplat
