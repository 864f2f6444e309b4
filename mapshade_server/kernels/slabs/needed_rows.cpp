#include "needed_rows.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>

namespace volsplat {

namespace {

constexpr std::int64_t kLongest = std::numeric_limits<std::uint16_t>::max() + 1;

std::int64_t bundles(std::int64_t rows, std::int64_t of) { return (rows + of - 1) / of; }

// Calls `take` with the numbers of those of a row of marks that are set.
template <class Take>
void each_set(const std::uint8_t* marks, std::int64_t count, const Take& take) {
    std::int64_t n = 0;
    for (; n + 8 <= count; n += 8) {
        std::uint64_t eight;
        std::memcpy(&eight, marks + n, sizeof eight);
        if (eight == 0) continue;
        for (int m = 0; m < 8; ++m)
            if (marks[n + m]) take(n + m);
    }
    for (; n < count; ++n)
        if (marks[n]) take(n);
}

}  // namespace

NeededRows::NeededRows(const Index3& size, int axis, const Need& need)
    : size_(size),
      axis_(axis),
      low_(axis == 0 ? 1 : 0),
      high_(axis == 2 ? 1 : 2),
      need_(need),
      bundles_across_(bundles(size[low_], kBundleRows)),
      slots_(bundles_across_ * bundles(size[high_], kBundleRows)) {}

const NeededRows::Bundle& NeededRows::find(std::size_t number, const std::uint32_t* packets) const {
    Slot& slot = slots_[number];
    const std::lock_guard locked(slot.finding);
    if (!slot.bundle) {
        const auto place = static_cast<std::int64_t>(number);
        slot.bundle = bundle_at(place % bundles_across_ * kBundleRows, place / bundles_across_ * kBundleRows, packets);
        slot.found.store(slot.bundle.get(), std::memory_order_release);
    }
    return *slot.bundle;
}

// Of the rows from these on.
std::unique_ptr<const NeededRows::Bundle> NeededRows::bundle_at(std::int64_t low, std::int64_t high,
                                                                const std::uint32_t* packets) const {
    Part part{{0, 0, 0}, size_}, own{{0, 0, 0}, size_};  // what is looked at, and what of it is kept
    const Index3 reach = need_.reach();
    for (const auto& [axis, first] : {std::pair{low_, low}, std::pair{high_, high}}) {
        const std::int64_t last = std::min(first + kBundleRows, size_[axis]);
        part.low[axis] = std::max<std::int64_t>(first - reach[axis], 0);
        part.size[axis] = std::min(last + reach[axis], size_[axis]) - part.low[axis];
        own.low[axis] = first, own.size[axis] = last - first;
    }
    const Bytes needed = needed_marks(packets, size_, part, need_);
    // Whichever axis it is, memory is read in its order
    const auto each = [&](const auto& take) {
        for (std::int64_t k = own.low[2]; k < own.low[2] + own.size[2]; ++k)
            for (std::int64_t j = own.low[1]; j < own.low[1] + own.size[1]; ++j) {
                const std::int64_t line = (k - part.low[2]) * part.size[1] + j - part.low[1];
                const std::uint8_t* const marks = needed.data() + line * part.size[0] + own.low[0] - part.low[0];
                each_set(marks, own.size[0], [&](std::int64_t n) {
                    const Index3 place{own.low[0] + n, j, k};
                    take((place[high_] - high) * kBundleRows + place[low_] - low, place);
                });
            }
    };
    auto bundle = std::make_unique<Bundle>();
    std::vector<std::uint32_t> ends(kBundleRows * kBundleRows);
    each([&](std::size_t row, const Index3&) { ++ends[row]; });
    std::uint32_t count = 0;
    for (std::uint32_t& end : ends) count += std::exchange(end, count);
    bundle->voxels.resize(count);
    // From now on an end is where the row's next voxel goes
    each([&](std::size_t row, const Index3& place) {
        const auto density = static_cast<std::uint8_t>(packets[(place[2] * size_[1] + place[1]) * size_[0] + place[0]]);
        bundle->voxels[ends[row]++] = {static_cast<std::uint16_t>(place[axis_]), density};
    });
    const NeededVoxel* begin = bundle->voxels.data();
    for (std::size_t row = 0; row < ends.size(); ++row)
        bundle->rows[row] = {begin, bundle->voxels.data() + ends[row]}, begin = bundle->rows[row].end;
    return bundle;
}

NeededVoxels::NeededVoxels(const Index3& size) : size_(size) {
    if (*std::max_element(size.begin(), size.end()) > kLongest)
        throw std::invalid_argument("a sub-cube for slabs is 65536 voxels long at most");
}

std::shared_ptr<const NeededRows> NeededVoxels::rows_along(int axis, const Need& need) {
    const std::lock_guard locked(mutex_);
    if (!rows_ || axis != rows_->axis() || need != rows_->need())
        rows_ = std::make_shared<NeededRows>(size_, axis, need);
    return rows_;
}

}  // namespace volsplat
