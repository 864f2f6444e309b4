// Keeps the lists within their share of memory.
#include "classified_rows.h"

#include <algorithm>
#include <cstring>
#include <new>

namespace volsplat {

namespace {

constexpr std::size_t kVoxelBytes = sizeof(std::uint32_t) + sizeof(std::uint16_t);

// Walkers get room for more than one list at a time, so that they seldom meet: a small part of all, and not too much.
constexpr std::size_t kChunks = 256;
constexpr std::size_t kLargestChunk = 1 << 14;

template <typename T>
void prefetch_array(const T* numbers, std::size_t count) {
    constexpr std::size_t kCacheLine = 64;
    constexpr std::size_t kMostBytes = 512;  // the CPU finds out by itself how longer ones go on
    const char* bytes = reinterpret_cast<const char*>(numbers);
    const std::size_t size = std::min(count * sizeof(T), kMostBytes);
    for (std::size_t at = 0; at < size; at += kCacheLine) __builtin_prefetch(bytes + at);
    if (size > 0) __builtin_prefetch(bytes + size - 1);
}

bool same(const Visibility& a, const Visibility& b) { return std::memcmp(&a, &b, sizeof(Visibility)) == 0; }

}  // namespace

RowLists::RowLists(std::size_t rows, std::size_t voxels)
    : rows_(rows),
      packets_(large_array<std::uint32_t>(voxels + kSpare)),
      positions_(large_array<std::uint16_t>(voxels + kSpare)) {}

void RowLists::prefetch(std::size_t soon, std::size_t later) const {
    if (later < rows_.size()) __builtin_prefetch(&rows_[later]);
    if (soon >= rows_.size() || !holds(soon)) return;
    const VisibleVoxels voxels = at(soon);
    prefetch_array(voxels.packets, voxels.count);
    prefetch_array(voxels.positions, voxels.count);
}

bool RowLists::claim(std::size_t row) {
    std::uint64_t expected = kUnknown;
    return rows_[row].compare_exchange_strong(expected, kClaimed, std::memory_order_relaxed);
}

void RowLists::add(std::size_t row, const VisibleVoxels& voxels, ListRoom& room) {
    std::memcpy(packets_.get() + room.next, voxels.packets, voxels.count * sizeof(std::uint32_t));
    std::memcpy(positions_.get() + room.next, voxels.positions, voxels.count * sizeof(std::uint16_t));
    const std::uint64_t begin = voxels.count == 0 ? 0 : room.next;  // all that are empty look the same
    rows_[row].store(begin << kBeginShift | voxels.count << kCountShift | kListed, std::memory_order_release);
    room.next += voxels.count;
}

std::size_t RowLists::bytes_with(std::size_t more_voxels) const {
    return rows_.size() * sizeof(Row) + std::max(most_filled_, filled_ + more_voxels) * kVoxelBytes;
}

void RowLists::enlarge(ListRoom& room, std::size_t more_voxels) {
    if (room.end != filled_) room.next = filled_;
    filled_ += more_voxels;
    room.end = filled_;
}

void RowLists::clear() {
    for (Row& row : rows_) row.store(kUnknown, std::memory_order_relaxed);
    most_filled_ = std::max(most_filled_, filled_);
    filled_ = 0;
}

ClassifiedRows::ClassifiedRows(const Index3& size, double share)
    : size_(size),
      most_bytes_(static_cast<std::size_t>(share * sizeof(std::uint32_t) * static_cast<double>(size[0]) *
                                           static_cast<double>(size[1]) * static_cast<double>(size[2]))) {}

std::shared_ptr<RowLists> ClassifiedRows::rows_along(int axis, const Visibility& visibility) {
    const std::lock_guard locked(mutex_);
    if (!same(visibility, visibility_)) forget_all_but(axis);
    visibility_ = visibility;
    Axis& wanted = axes_[axis];
    wanted.last_walk = ++walks_;
    if (wanted.lists || wanted.too_large || size_[axis] > kLongestRow) return wanted.lists;
    const std::size_t rows = static_cast<std::size_t>(size_[(axis + 1) % 3] * size_[(axis + 2) % 3]);
    try {
        wanted.lists = std::make_shared<RowLists>(rows, most_bytes_ / kVoxelBytes);
    } catch (const std::bad_alloc&) {
        wanted.too_large = true;
        return nullptr;
    }
    may_grow(axis, *wanted.lists, 0);
    return wanted.lists;
}

bool ClassifiedRows::make_room(int axis, RowLists& growing, std::size_t voxels, ListRoom& room) {
    if (room.end - room.next >= voxels) return true;
    const std::lock_guard locked(mutex_);
    if (axes_[axis].lists.get() != &growing || !may_grow(axis, growing, voxels)) return false;
    const std::size_t chunk = std::clamp(most_bytes_ / kVoxelBytes / kChunks, voxels, std::max(voxels, kLargestChunk));
    const bool spacious = bytes_locked() - growing.bytes() + growing.bytes_with(chunk) <= most_bytes_;
    growing.enlarge(room, spacious ? chunk : voxels);
    return true;
}

// Forgets other lists where it must, or these.
bool ClassifiedRows::may_grow(int axis, const RowLists& growing, std::size_t voxels) {
    while (bytes_locked() - growing.bytes() + growing.bytes_with(voxels) > most_bytes_) {
        Axis* oldest = nullptr;
        for (Axis& other : axes_) {
            if (&other == &axes_[axis] || !other.lists) continue;
            if (!oldest || other.last_walk < oldest->last_walk) oldest = &other;
        }
        if (!oldest) {
            axes_[axis].lists.reset();
            axes_[axis].too_large = true;
            return false;
        }
        oldest->lists.reset();
    }
    return true;
}

std::size_t ClassifiedRows::bytes() const {
    const std::lock_guard locked(mutex_);
    return bytes_locked();
}

std::size_t ClassifiedRows::bytes_locked() const {
    std::size_t all = 0;
    for (const Axis& axis : axes_) all += axis.lists ? axis.lists->bytes() : 0;
    return all;
}

std::vector<int> ClassifiedRows::axes() const {
    const std::lock_guard locked(mutex_);
    std::vector<int> kept;
    for (int axis = 0; axis < 3; ++axis) {
        if (axes_[axis].lists) kept.push_back(axis);
    }
    return kept;
}

// Where its lists are not in use, an axis keeps their memory for those that come.
void ClassifiedRows::forget_all_but(int axis) {
    std::shared_ptr<RowLists> lists = std::move(axes_[axis].lists);
    axes_ = {};
    if (lists.use_count() != 1) return;
    lists->clear();
    axes_[axis].lists = std::move(lists);
}

}  // namespace volsplat
