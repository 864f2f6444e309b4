// One frame of an image: its regions, and the sources whose packets they are splatted from.
//
// Sources are map/shade servers' walkers, whose batches any thread pushes. What is buffered of a source is bounded, and
// that cannot deadlock: a batch has reached the same place of the traversal for all regions, so that of the source that
// is the furthest behind all that is buffered is decided everywhere, will be splatted without anything more being read,
// and opens its budget again. Only sources that share a budget, the walkers of one server, may close it to one another:
// if all regions wait, whoever is awaited must be read, whatever is buffered.
//
// Or each region has a walk of this process, its one source, so that owners share nothing: an owner in whose regions
// nothing is decided takes a step of its own walks, and once these have ended of another's. So those whose regions or
// cores are slow walk less.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <exception>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "bell.h"
#include "kernels/batch_source.h"
#include "read_budget.h"
#include "region.h"
#include "sleepers.h"
#include "source_rules.h"

namespace volsplat {

struct FrameTask {
    std::vector<RowSpan> regions;  // that follow each other
    SplatJob job;                  // but for image, lines and spans
    EdgeLayers layers;
    FrameCounts counts;
    int sources;                        // that are pushed
    std::vector<BatchSource*> walks;    // or one for each region, and no sources
    bool traced;                        // whether spans are recorded
    std::uint64_t portion;              // packets that are splatted between two looks at whether to go on
    std::shared_ptr<const void> keeps;  // what all of this points to
};

struct Walked {  // what walks have handed out
    std::int64_t steps = 0, voxels = 0, packets = 0, bytes = 0;
};

struct TileWords {  // of the map of closed tiles, from the first on
    const std::uint64_t* words;
    std::size_t first, count;
};

struct FrameBells {
    std::vector<std::shared_ptr<Bell>> owners;
    std::shared_ptr<Bell> news;      // the frame is complete, or has failed, or has gone on since reached() was asked
    std::shared_ptr<Bell> all_wait;  // regions, for something to be pushed
};

class SplatFrame {
public:
    // Regions are dealt out to the owners by turns.
    SplatFrame(FrameTask task, std::shared_ptr<ImageMemory> image, std::shared_ptr<float[]> block, FrameBells bells);

    // Any threads.

    // Takes a batch of a source. Throws std::invalid_argument naming the fault if it breaks the rules.
    void push(int source, std::span<const PartView> parts, std::uint64_t reached_sheet, std::uint64_t reached_row,
              bool last, const std::shared_ptr<const void>& memory);
    // Nothing more will come from the source. What it has handed out is still merged.
    void finish(int source);
    bool finished(int source);  // waits for nobody: whoever asks may hold the GIL
    // Nothing is splatted any more, once its owners have noticed.
    void stop() { stopped_ = true; }
    // Rethrows what an owner failed of.
    bool complete() const;
    bool unfinished() const { return unfinished_ != 0; }  // as complete(), but that it never throws
    // The sources without which no region can go on; none if one can.
    std::vector<int> awaited() const;
    // The image as it stands, into a block of its own.
    void show(const PixelBlock& target);
    const PixelBlock& block() const { return block_; }
    const std::shared_ptr<float[]>& pixels() const { return pixels_; }
    std::uint64_t packets() const;
    std::uint64_t hidden_packets() const;
    // All that lies before it has been splatted in every region; kEnd once that is all.
    Place reached();
    ImageMemory& image() { return *image_; }
    // Those of its regions. Bits rise while it is drawn.
    TileWords closed_tiles() const;

    // Once it is complete.
    const std::vector<std::uint64_t>& work() const { return work_; }
    const std::vector<OwnerRecord>& records() const { return records_; }
    Walked walked() const;

    // For its owners: splats a portion or walks a step. False if there is nothing to do until the owner's bell rings.
    bool proceed(int owner);
    // For its owners: the frame ends with this.
    void fail(std::exception_ptr failure);
    // Once its owners are at it no more: leaves the image empty.
    void drop();
    // Once it is stopped and its owners are at it no more: opens the budgets of what it has buffered.
    void let_go();

private:
    struct Walk;
    struct Source {
        Source(const FrameCounts& counts, std::size_t regions) : rules(counts, regions) {}
        std::mutex mutex;  // its batches, and its end, come one after the other
        SourceRules rules;
    };

    Source& source_at(int number);
    int owner_of(std::size_t region) const { return static_cast<int>(region % bells_.owners.size()); }
    void deliver(std::size_t region, Arrival arrival);
    bool splat(int owner);
    bool wait(int owner);
    bool walk(int owner);
    bool walks_are_free() const;
    Walk* free_walk(std::size_t first, std::size_t every) const;
    Walk* take_walk(int owner);
    void push_step(Walk& walk, Step step);
    void publish(Region& region, int owner);
    void tell_if_all_wait();
    void tell_progress();

    const FrameTask task_;
    const std::shared_ptr<ImageMemory> image_;
    const std::shared_ptr<float[]> pixels_;
    const FrameBells bells_;
    std::vector<std::uint64_t> work_;
    std::vector<std::unique_ptr<Region>> regions_;
    PixelBlock block_;
    std::vector<std::unique_ptr<Source>> sources_;
    struct Walk {
        Walk(std::size_t region_, BatchSource* source_, const FrameCounts& counts, std::shared_ptr<ReadBudget> budget_)
            : region(region_), source(source_), budget(std::move(budget_)), rules(counts, 1) {}
        bool free() const { return !taken && budget->open(); }

        const std::size_t region;
        BatchSource* const source;
        const std::shared_ptr<ReadBudget> budget;
        std::atomic<bool> taken{false};  // by an owner; for good once it has ended
        std::atomic<Place> reached{Place{0, 0}};
        // Its taker's
        SourceRules rules;
        Walked walked{};
    };
    const std::shared_ptr<Sleepers> sleepers_;  // who would walk
    std::vector<std::unique_ptr<Walk>> walks_;
    std::vector<OwnerRecord> records_;
    std::atomic<int> unfinished_;  // regions
    std::atomic<int> waiting_{0};  // of them
    std::atomic<bool> stopped_{false};
    std::atomic<bool> asked_{false};    // how far it is, since that was told
    mutable std::mutex failure_mutex_;  // guards the next
    std::exception_ptr failure_;
};

}  // namespace volsplat
