#include "batch_taker.h"

#include <cstring>
#include <iterator>
#include <new>
#include <stdexcept>
#include <utility>

#include "batch_parts.h"

namespace volsplat {

namespace {

constexpr double kLookSeconds = 1.0;  // between two looks, if the other process has spoilt the bell
// Batches of a walker and frame that hold nothing: no block bounds how many of them wait for other sources.
constexpr int kMostEmpty = 1 << 16;

// As it is at one moment: the other process may write meanwhile.
BatchNote note_of(BlockHead& head) {
    BatchNote note;
    std::uint64_t words[sizeof note / sizeof(std::uint64_t)];
    auto* const from = reinterpret_cast<std::uint64_t*>(&head.note);
    for (std::size_t n = 0; n < std::size(words); ++n)
        words[n] = std::atomic_ref<std::uint64_t>(from[n]).load(std::memory_order_relaxed);
    std::memcpy(&note, words, sizeof note);
    return note;
}

}  // namespace

// A block that is read: freed on destruction, by when its packets have closed tiles.
class BatchTaker::TakenBlock {
public:
    TakenBlock(std::shared_ptr<ChannelMemory> memory, std::shared_ptr<TileTeller> tiles, std::shared_ptr<Flags> taken,
               int walker, int block)
        : memory_(std::move(memory)),
          tiles_(std::move(tiles)),
          taken_(std::move(taken)),
          walker_(walker),
          block_(block) {}
    ~TakenBlock() {
        tiles_->tell();
        (*taken_)[walker_ * memory_->shape().blocks + block_] = false;
        memory_->head(walker_, block_).state.store(kFree);
        memory_->freed(walker_).ring();
    }
    TakenBlock(const TakenBlock&) = delete;
    TakenBlock& operator=(const TakenBlock&) = delete;

private:
    const std::shared_ptr<ChannelMemory> memory_;
    const std::shared_ptr<TileTeller> tiles_;
    const std::shared_ptr<Flags> taken_;
    const int walker_, block_;
};

BatchTaker::BatchTaker(std::shared_ptr<ChannelMemory> memory, std::shared_ptr<Bell> news)
    : memory_(std::move(memory)),
      news_(std::move(news)),
      tiles_(std::make_shared<TileTeller>(memory_)),
      taken_(std::make_shared<Flags>(std::size_t(memory_->shape().walkers) * memory_->shape().blocks)),
      next_block_(memory_->shape().walkers),
      empty_(memory_->shape().walkers) {
    thread_ = std::thread([this] { work(); });
}

void BatchTaker::begin(std::int64_t frame, std::shared_ptr<SplatFrame> into, int first_source, int walkers,
                       bool traced) {
    {
        const auto lock = locked();
        if (frame != frame_) bytes_ = 0, spans_.clear(), empty_.assign(empty_.size(), 0);
        if (into != into_) tiles_->begin(frame, into);
        frame_ = frame, first_source_ = first_source, walkers_ = walkers, traced_ = traced;
        into_.swap(into);
        look_at_newest();
    }
    memory_->filled().ring_anyway();
}

void BatchTaker::close() {
    closed_ = true;
    memory_->filled().ring_anyway();
    const std::lock_guard lock(joining_);
    if (thread_.joinable()) thread_.join();
}

// Whoever fills on meanwhile is not waited for.
void BatchTaker::drain() {
    for (int n = 0; n < memory_->shape().blocks && take_any(); ++n) continue;
}

std::string BatchTaker::fault() {
    const auto lock = locked();
    return fault_;
}

std::vector<TakenSpan> BatchTaker::spans() {
    const auto lock = locked();
    return spans_;
}

std::unique_lock<std::mutex> BatchTaker::locked() {
    const std::lock_guard gate(gate_);
    return std::unique_lock(mutex_);
}

void BatchTaker::work() {
    while (!closed_) {
        const std::uint32_t heard = memory_->filled().rung();
        if (!take_any() && !closed_) memory_->filled().wait(heard, kLookSeconds);
    }
}

// One of each walker: none waits for all that another has.
bool BatchTaker::take_any() {
    bool any = false;
    for (int walker = 0; walker < memory_->shape().walkers; ++walker) any |= take(walker);
    return any;
}

bool BatchTaker::take(int walker) {
    const auto lock = locked();
    const int block = next_block_[walker];
    BlockHead& head = memory_->head(walker, block);
    if (!fault_.empty() || head.state.load() != kFilled) return false;
    const BatchNote note = note_of(head);
    if (note.frame > newest_frame_) {
        newest_frame_ = note.frame;
        look_at_newest();
    }
    if (note.frame > frame_) return false;
    try {
        take_filled(walker, block, note);
    } catch (const std::bad_alloc&) {
        fail("the memory does not suffice for its batches");
    } catch (const std::exception& fault) {
        fail(fault.what());
    }
    return true;
}

void BatchTaker::take_filled(int walker, int block, const BatchNote& note) {
    const Clock::time_point began = Clock::now();
    std::atomic<bool>& flag = (*taken_)[walker * memory_->shape().blocks + block];
    if (flag.exchange(true)) throw std::invalid_argument("a block was filled before it was free");
    auto taken = std::make_shared<TakenBlock>(memory_, tiles_, taken_, walker, block);
    memory_->head(walker, block).state.store(kTaken);
    next_block_[walker] = (block + 1) % memory_->shape().blocks;
    if (note.frame < frame_ || !into_) return;
    push(walker, note, memory_->block(walker, block), std::move(taken));
    if (traced_) spans_.push_back({walker, began, Clock::now()});
}

void BatchTaker::push(int walker, const BatchNote& note, const unsigned char* block,
                      std::shared_ptr<const void> taken) {
    if (walker >= walkers_)
        throw std::invalid_argument(walkers_ ? "walker " + std::to_string(walker) + " has no part in this frame"
                                             : "it has no part in this frame");
    const std::size_t bytes = memory_->shape().block_bytes;
    if (note.regions > bytes / sizeof(PartCounts))
        throw std::invalid_argument("a batch has " + std::to_string(note.regions) + " parts, more than a block holds");
    std::vector<PartCounts> counts(note.regions);
    const std::size_t counted = counts.size() * sizeof(PartCounts);
    if (counted) std::memcpy(counts.data(), block, counted);
    std::vector<PartView> parts;
    const std::size_t used = lay_out(counts, block + counted, bytes - counted, parts);
    auto runs = copied_runs(parts);
    if (runs.empty() && ++empty_[walker] > kMostEmpty)
        throw std::invalid_argument("more batches came that hold nothing than a frame can have");
    auto memory = std::make_shared<std::pair<std::shared_ptr<const void>, std::vector<unsigned char>>>(std::move(taken),
                                                                                                       std::move(runs));
    bytes_ += static_cast<std::int64_t>(used);
    into_->push(first_source_ + walker, parts, note.reached_sheet, note.reached_row, note.last != 0, memory);
}

// Nobody is woken for a batch that comes between frames: it waits for the message that begins its own.
void BatchTaker::look_at_newest() {
    if (newest_frame_ <= frame_) return;
    has_news_ = true;
    if (into_ && into_->unfinished()) news_->ring();
}

void BatchTaker::fail(const char* fault) noexcept {
    try {
        fault_ = "frame " + std::to_string(frame_) + ": " + fault;
    } catch (const std::bad_alloc&) {
        fault_ = "no memory";  // in the string itself
    }
    has_news_ = true;
    news_->ring();
}

}  // namespace volsplat
