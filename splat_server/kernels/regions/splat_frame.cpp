#include "splat_frame.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

namespace volsplat {

namespace {

// Bytes of a walk that may be buffered: some steps, so that owners need not go on together although their regions and
// cores differ, and few enough that they lie in the caches and that little is walked that has become hidden meanwhile.
constexpr std::int64_t kWalkBudget = 1 << 19;

// A walk of another owner's region is taken before one's own if it is behind by this part of the sheets: enough that
// owners seldom read from each other's caches, and so few that no region is long the last.
constexpr std::uint64_t kSheetsBehind = 16;

RowSpan all_lines(const std::vector<RowSpan>& regions) { return {regions.front().begin, regions.back().end}; }

}  // namespace

SplatFrame::SplatFrame(FrameTask task, std::shared_ptr<ImageMemory> image, std::shared_ptr<float[]> block,
                       FrameBells bells)
    : task_(std::move(task)),
      image_(std::move(image)),
      pixels_(std::move(block)),
      bells_(std::move(bells)),
      work_(image_->tile_rows()),
      block_{pixels_.get(), rectangle_of(*image_, all_lines(task_.regions))},
      sleepers_(std::make_shared<Sleepers>(bells_.owners)),
      records_(bells_.owners.size(), OwnerRecord{{}, task_.traced, {}}),
      unfinished_(static_cast<int>(task_.regions.size())) {
    SplatJob job = task_.job;
    job.image = image_->view();
    job.work = work_.data();
    for (const RowSpan& lines : task_.regions) {
        job.row_begin = lines.begin, job.row_end = lines.end;
        regions_.push_back(
            std::make_unique<Region>(*image_, job, task_.walks.empty() ? task_.sources : 1, task_.layers));
    }
    for (int n = 0; n < task_.sources; ++n) sources_.push_back(std::make_unique<Source>(task_.counts, regions_.size()));
    for (std::size_t n = 0; n < task_.walks.size(); ++n) {
        auto budget = std::make_shared<ReadBudget>(kWalkBudget, [sleepers = sleepers_] { sleepers->wake_one(); });
        walks_.push_back(std::make_unique<Walk>(n, task_.walks[n], task_.counts, std::move(budget)));
    }
}

TileWords SplatFrame::closed_tiles() const {
    const RowSpan lines = all_lines(task_.regions);
    const auto row = static_cast<std::size_t>(image_->tile_words());
    const std::size_t first = lines.begin / kTileSide * row, end = (lines.end + kTileSide - 1) / kTileSide * row;
    return {image_->closed_tiles() + first, first, end - first};
}

SplatFrame::Source& SplatFrame::source_at(int number) {
    if (number < 0 || number >= static_cast<int>(sources_.size()))
        throw std::invalid_argument("source " + std::to_string(number) + " is not part of this frame");
    return *sources_[number];
}

void SplatFrame::push(int number, std::span<const PartView> parts, std::uint64_t reached_sheet,
                      std::uint64_t reached_row, bool last, const std::shared_ptr<const void>& memory) {
    Source& source = source_at(number);
    const std::lock_guard lock(source.mutex);
    source.rules.check(parts, reached_sheet, reached_row, last);
    if (stopped_) return;
    for (std::size_t n = 0; n < parts.size(); ++n) {
        const SpanView& runs = parts[n].runs;
        deliver(n, {number, runs, runs.run_count ? memory : nullptr, source.rules.bound(n), last});
    }
}

void SplatFrame::finish(int number) {
    Source& source = source_at(number);
    const std::lock_guard lock(source.mutex);
    if (!source.rules.finish()) return;
    for (std::size_t n = 0; n < regions_.size(); ++n) deliver(n, {number, {}, nullptr, source.rules.bound(n), true});
}

bool SplatFrame::finished(int number) { return source_at(number).rules.finished(); }

// Wakes only an owner that has waited for it; others find it when they look for more.
void SplatFrame::deliver(std::size_t region, Arrival arrival) {
    if (!regions_[region]->put(std::move(arrival))) return;
    --waiting_;
    bells_.owners[owner_of(region)]->ring();
}

bool SplatFrame::proceed(int owner) {
    sleepers_->get_up(owner);
    if (stopped_) return false;
    if (splat(owner) || !wait(owner) || walk(owner)) return true;
    sleepers_->lie_down(owner);
    return walks_are_free();  // since it was looked
}

// A portion of each of its regions.
bool SplatFrame::splat(int owner) {
    bool splatted = false;
    for (std::size_t n = owner; n < regions_.size() && !stopped_; n += bells_.owners.size()) {
        Region& region = *regions_[n];
        if (region.published() || region.awaited() >= 0) continue;
        const Place before = region.reached();
        splatted |= region.advance(task_.portion, records_[owner]);
        if (region.reached() != before) tell_progress();
        if (region.complete()) publish(region, owner);
    }
    return splatted;
}

bool SplatFrame::wait(int owner) {
    for (std::size_t n = owner; n < regions_.size(); n += bells_.owners.size()) {
        Region& region = *regions_[n];
        if (region.published() || region.awaited() >= 0) continue;
        ++waiting_;  // before anyone can find that it does
        if (!region.wait()) {
            --waiting_;
            return false;
        }
    }
    tell_if_all_wait();
    return true;
}

void SplatFrame::publish(Region& region, int owner) {
    {
        const Stopwatch watch(records_[owner], kSplatting);
        region.publish(block_);
    }
    records_[owner].seconds.slabs += region.slab_seconds();
    if (--unfinished_ == 0) bells_.news->ring();
    else tell_if_all_wait();
}

bool SplatFrame::walks_are_free() const {
    return std::any_of(walks_.begin(), walks_.end(), [](const auto& walk) { return walk->free(); });
}

// Of every so many walks from the first one on that which is the furthest behind; none if no walk is free.
SplatFrame::Walk* SplatFrame::free_walk(std::size_t first, std::size_t every) const {
    Walk* last = nullptr;
    for (std::size_t n = first; n < walks_.size(); n += every) {
        Walk* const walk = walks_[n].get();
        if (walk->free() && (!last || walk->reached.load() < last->reached.load())) last = walk;
    }
    return last;
}

// Of its own regions, unless another is far behind.
SplatFrame::Walk* SplatFrame::take_walk(int owner) {
    const std::uint64_t far = task_.counts.sheets / kSheetsBehind;
    while (true) {
        Walk* walk = free_walk(owner, bells_.owners.size());
        Walk* const other = free_walk(0, 1);
        if (!walk || (other && other->reached.load().sheet + far < walk->reached.load().sheet)) walk = other;
        if (!walk || !walk->taken.exchange(true)) return walk;
    }
}

bool SplatFrame::walk(int owner) {
    Walk* const walk = take_walk(owner);
    if (!walk) return false;
    Step step;
    {
        const Stopwatch watch(records_[owner], kWalking);
        step = walk->source->next();
    }
    const bool last = step.last;
    push_step(*walk, std::move(step));
    walk->taken = last;
    if (walk->free()) sleepers_->wake_one();
    return true;
}

void SplatFrame::push_step(Walk& walk, Step step) {
    std::vector<PartView> parts;
    std::int64_t packets = 0, bytes = 0;
    for (const BatchPart& part : step.parts) {
        const SpanView runs{reinterpret_cast<const unsigned char*>(part.runs),
                            reinterpret_cast<const unsigned char*>(part.packets), part.run_count};
        parts.push_back({runs, part.packet_count});
        packets += part.packet_count;
        bytes += part.run_count * sizeof(RowRun) + part.packet_count * kPacketBytes;
    }
    Walked& sum = walk.walked;
    sum = {sum.steps + 1, sum.voxels + step.voxels_visited, sum.packets + packets, sum.bytes + bytes};
    walk.reached = Place{static_cast<std::uint32_t>(step.reached_row), static_cast<std::uint32_t>(step.reached_sheet)};
    walk.rules.check(parts, step.reached_sheet, step.reached_row, step.last);
    if (stopped_) return;
    const auto memory = std::make_shared<HeldMemory>(std::move(step.memory), walk.budget, bytes);
    deliver(walk.region,
            {0, parts[0].runs, parts[0].runs.run_count ? memory : nullptr, walk.rules.bound(0), step.last});
}

Walked SplatFrame::walked() const {
    Walked sum;
    for (const auto& walk : walks_) {
        const Walked& one = walk->walked;
        sum = {sum.steps + one.steps, sum.voxels + one.voxels, sum.packets + one.packets, sum.bytes + one.bytes};
    }
    return sum;
}

// In case that sources are held back.
void SplatFrame::tell_if_all_wait() {
    if (task_.walks.empty() && waiting_ == unfinished_) bells_.all_wait->ring();
}

// Once for each time that it was asked: a frame goes on more often than anyone wants to know.
void SplatFrame::tell_progress() {
    if (asked_ && asked_.exchange(false)) bells_.news->ring();
}

Place SplatFrame::reached() {
    asked_ = true;  // before looking: what comes next is told
    Place least = kEnd;
    for (const auto& region : regions_) least = std::min(least, region->reached());
    return least;
}

std::vector<int> SplatFrame::awaited() const {
    std::vector<int> sources;
    if (waiting_ != unfinished_) return sources;
    for (const auto& region : regions_)
        if (const int source = region->awaited(); source >= 0) sources.push_back(source);
    return sources;
}

bool SplatFrame::complete() const {
    const std::lock_guard lock(failure_mutex_);
    if (failure_) std::rethrow_exception(failure_);
    return unfinished_ == 0;
}

void SplatFrame::fail(std::exception_ptr failure) {
    {
        const std::lock_guard lock(failure_mutex_);
        failure_ = std::move(failure);
    }
    stop();
    bells_.news->ring();
}

void SplatFrame::show(const PixelBlock& target) {
    for (const auto& region : regions_) region->show(block_, target);
}

std::uint64_t SplatFrame::packets() const {
    std::uint64_t sum = 0;
    for (const auto& region : regions_) sum += region->packets();
    return sum;
}

std::uint64_t SplatFrame::hidden_packets() const {
    std::uint64_t sum = 0;
    for (const auto& region : regions_) sum += region->hidden_packets();
    return sum;
}

void SplatFrame::let_go() {
    for (const auto& source : sources_) const std::lock_guard pushed(source->mutex);  // by who saw it not yet stopped
    for (const auto& region : regions_) region->let_go();
}

void SplatFrame::drop() {
    for (const auto& region : regions_) region->drop();
}

}  // namespace volsplat
