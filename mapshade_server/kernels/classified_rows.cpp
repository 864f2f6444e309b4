// Keeps the lists within their share of memory.
#include "classified_rows.h"

#include <algorithm>
#include <cstring>
#include <new>

namespace volsplat {

namespace {

constexpr std::size_t kVoxelBytes = sizeof(std::uint32_t) + sizeof(std::uint16_t);

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
    : rows_(rows, Row{0, kUnknown}),
      packets_(large_array<std::uint32_t>(voxels + kSpare)),
      positions_(large_array<std::uint16_t>(voxels + kSpare)) {}

void RowLists::prefetch(std::size_t soon, std::size_t later) const {
    if (later < rows_.size()) __builtin_prefetch(&rows_[later]);
    if (soon >= rows_.size() || !holds(soon)) return;
    const VisibleVoxels voxels = at(soon);
    prefetch_array(voxels.packets, voxels.count);
    prefetch_array(voxels.positions, voxels.count);
}

void RowLists::add(std::size_t row, const VisibleVoxels& voxels) {
    std::memcpy(packets_.get() + filled_, voxels.packets, voxels.count * sizeof(std::uint32_t));
    std::memcpy(positions_.get() + filled_, voxels.positions, voxels.count * sizeof(std::uint16_t));
    rows_[row] = {filled_, voxels.count};
    filled_ += voxels.count;
}

void RowLists::clear() {
    rows_.assign(rows_.size(), Row{0, kUnknown});
    most_filled_ = std::max(most_filled_, filled_);
    filled_ = 0;
}

std::size_t RowLists::bytes_with(std::size_t more_voxels) const {
    return rows_.size() * sizeof(Row) + std::max(most_filled_, filled_ + more_voxels) * kVoxelBytes;
}

ClassifiedRows::ClassifiedRows(const Index3& size, double share)
    : size_(size),
      most_bytes_(static_cast<std::size_t>(share * sizeof(std::uint32_t) * static_cast<double>(size[0]) *
                                           static_cast<double>(size[1]) * static_cast<double>(size[2]))) {}

std::shared_ptr<RowLists> ClassifiedRows::rows_along(int axis, const Visibility& visibility) {
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
    make_room(axis, *wanted.lists, 0);
    return wanted.lists;
}

bool ClassifiedRows::make_room(int axis, const RowLists& growing, std::size_t voxels) {
    if (axes_[axis].lists.get() != &growing) return false;
    while (bytes() - growing.bytes() + growing.bytes_with(voxels) > most_bytes_) {
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
    std::size_t all = 0;
    for (const Axis& axis : axes_) all += axis.lists ? axis.lists->bytes() : 0;
    return all;
}

std::vector<int> ClassifiedRows::axes() const {
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
