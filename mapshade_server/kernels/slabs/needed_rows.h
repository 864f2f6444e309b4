// The voxels of a box that a frame of slabs needs, in rows along one axis, kept from frame to frame. They are found
// some rows at a time, when one of these is walked first: what lies in front is drawn before anybody looks at the rest.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "needed_voxels.h"

namespace volsplat {

// Of a voxel its position in the row and its density.
struct NeededVoxel {
    std::uint16_t position;
    std::uint8_t density;
};

struct NeededRow {
    const NeededVoxel *begin, *end;
};

class NeededRows {
public:
    NeededRows(const Index3& size, int axis, const Need& need);

    int axis() const { return axis_; }
    const Need& need() const { return need_; }

    // The row through a place in the box, whose packets are always the same. Any thread may ask.
    NeededRow row(const Index3& place, const std::uint32_t* packets) const {
        const std::int64_t low = place[low_], high = place[high_];
        const std::size_t number = high / kBundleRows * bundles_across_ + low / kBundleRows;
        const Bundle* bundle = slots_[number].found.load(std::memory_order_acquire);
        if (!bundle) bundle = &find(number, packets);
        return bundle->rows[high % kBundleRows * kBundleRows + low % kBundleRows];
    }

private:
    static constexpr std::int64_t kBundleRows = 32;  // along either other axis

    struct Bundle {
        std::vector<NeededVoxel> voxels;
        NeededRow rows[kBundleRows * kBundleRows];
    };

    struct Slot {
        std::atomic<const Bundle*> found{nullptr};
        std::unique_ptr<const Bundle> bundle;
        std::mutex finding;
    };

    const Bundle& find(std::size_t number, const std::uint32_t* packets) const;
    std::unique_ptr<const Bundle> bundle_at(std::int64_t low, std::int64_t high, const std::uint32_t* packets) const;

    const Index3 size_;
    const int axis_;
    const int low_, high_;  // the other two axes
    const Need need_;
    const std::int64_t bundles_across_;
    mutable std::vector<Slot> slots_;
};

class NeededVoxels {
public:
    // Throws std::invalid_argument for a box whose rows positions cannot count.
    explicit NeededVoxels(const Index3& size);

    const Index3& size() const { return size_; }

    // Those of the axis that was asked for last are kept. Any thread may ask.
    std::shared_ptr<const NeededRows> rows_along(int axis, const Need& need);

private:
    const Index3 size_;
    std::mutex mutex_;  // guards the next
    std::shared_ptr<const NeededRows> rows_;
};

}  // namespace volsplat
