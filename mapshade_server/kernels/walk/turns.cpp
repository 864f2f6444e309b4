// Whole sheets where there are enough of them, else blocks of rows.
#include "turns.h"

#include <algorithm>

#include "mapshade_server/kernels/paths/map_shade_kernels.h"

namespace volsplat {

namespace {

constexpr std::int64_t kManyTurns = 8;  // the last one then hardly matters
constexpr std::int64_t kMostRows = 4;   // in a block

}  // namespace

// Sheets along i share strips of columns from one to the next, which stay with the walker of the row; rows along i
// share them on the sheet.
Turns::Turns(const WalkPlan& plan, std::int64_t walkers, std::int64_t sheets, std::int64_t rows,
             std::int64_t first_column)
    : walkers_(walkers), whole_sheets_(walkers == 1 || (plan.axes[0] != 0 && sheets >= kManyTurns * walkers)) {
    const AxisVisits& visits = plan.visits_of(1);
    const std::int64_t in_block =
        whole_sheets_ ? visits.count : std::clamp<std::int64_t>(rows / (kManyTurns * walkers), 1, kMostRows);
    const bool by_strips = !whole_sheets_ && plan.axes[1] == 0;
    const auto block = [&](std::int64_t row) {
        const std::int64_t ordinal = plan.ascending[1] ? row : visits.count - 1 - row;
        return by_strips ? (visits.index(ordinal) + kStripLanes - first_column % kStripLanes) / kStripLanes
                         : row / in_block;
    };
    for (std::int64_t row = 0; row < visits.count; ++row) {
        if (row == 0 || block(row) != block(row - 1)) begins_.push_back(row);
        block_of_row_.push_back(static_cast<std::int32_t>(begins_.size() - 1));
    }
    begins_.push_back(visits.count);
    blocks_for_each_sheet_ = plan.axes[0] == 0 ? 0 : static_cast<std::int64_t>(begins_.size()) - 1;
}

std::int64_t Turns::next_sheet(std::int64_t walker, std::int64_t sheet) const {
    if (!whole_sheets_) return sheet;
    return sheet + (walkers_ + walker - sheet % walkers_) % walkers_;
}

std::int64_t Turns::next_row(std::int64_t walker, std::int64_t sheet, std::int64_t row) const {
    const std::int64_t rows = begins_.back(), blocks = static_cast<std::int64_t>(begins_.size()) - 1;
    if (row >= rows) return rows;
    const std::int64_t block = block_of_row_[row];
    const std::int64_t turn = (sheet * blocks_for_each_sheet_ + block) % walkers_;
    const std::int64_t mine = block + (walkers_ + walker - turn) % walkers_;
    return mine == block ? row : begins_[std::min(mine, blocks)];
}

}  // namespace volsplat
