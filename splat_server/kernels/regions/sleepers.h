// Which owners have nothing to do until they are woken.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <vector>

#include "bell.h"

namespace volsplat {

// An owner who lies down and then looks once more whether there is something to do misses nothing.
class Sleepers {
public:
    explicit Sleepers(const std::vector<std::shared_ptr<Bell>>& bells) : bells_(bells), asleep_(bells.size()) {}

    void lie_down(int owner) { asleep_[owner] = true; }
    void get_up(int owner) { asleep_[owner] = false; }

    // One of them, if there is any.
    void wake_one() {
        for (std::size_t owner = 0; owner < bells_.size(); ++owner) {
            if (!asleep_[owner] || !asleep_[owner].exchange(false)) continue;
            bells_[owner]->ring();
            return;
        }
    }

private:
    const std::vector<std::shared_ptr<Bell>> bells_;
    std::vector<std::atomic<bool>> asleep_;
};

}  // namespace volsplat
