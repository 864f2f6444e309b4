// Blocks that keep strips of columns whole, which are classified together.
#include "turns.h"

#include <algorithm>
#include <bit>
#include <numeric>

#include "mapshade_server/kernels/paths/map_shade_kernels.h"

namespace volsplat {

namespace {

constexpr std::int64_t kManyTurns = 8;     // the last one then hardly matters
constexpr std::int64_t kRowsThatStay = 4;  // at most in a block, where each sheet is dealt alike

std::int64_t power_of_two(std::int64_t fitting, std::int64_t most) {
    const std::int64_t limited = std::clamp<std::int64_t>(fitting, 1, most);
    return static_cast<std::int64_t>(std::bit_floor(static_cast<std::uint64_t>(limited)));
}

}  // namespace

Turns::Turns(const WalkPlan& plan, std::int64_t walkers, std::int64_t sheets, std::int64_t rows,
             std::int64_t first_column)
    : walkers_(walkers) {
    // Along i sheets share strips from one to the next, which stay with the walker of the row, and rows on the sheet
    const bool rows_stay = plan.axes[0] == 0, rows_share = plan.axes[1] == 0;
    const std::int64_t turns = kManyTurns * walkers;
    const std::int64_t in_block = rows_stay    ? power_of_two(rows / turns, kRowsThatStay)
                                  : rows_share ? kStripLanes
                                               : power_of_two(sheets * rows / turns, kStripLanes);
    const AxisVisits& visits = plan.visits_of(1);
    const auto block = [&](std::int64_t row) {
        const std::int64_t ordinal = plan.ascending[1] ? row : visits.count - 1 - row;
        return rows_share ? (visits.index(ordinal) + in_block - first_column % in_block) / in_block : row / in_block;
    };
    for (std::int64_t row = 0; row < visits.count; ++row) {
        if (row == 0 || block(row) != block(row - 1)) begins_.push_back(row);
        block_of_row_.push_back(static_cast<std::int32_t>(begins_.size() - 1));
    }
    // In time every walker gets every block
    sheet_step_ = rows_stay ? 0 : static_cast<std::int64_t>(begins_.size());
    while (!rows_stay && std::gcd(sheet_step_, walkers) != 1) ++sheet_step_;
    begins_.push_back(visits.count);
    spread_ = rows_stay ? walkers : 1;
}

std::int64_t Turns::next_row(std::int64_t walker, std::int64_t sheet, std::int64_t row) const {
    if (row >= rows()) return rows();
    const std::int64_t block = block_of_row_[row], turn = (sheet * sheet_step_ + block) % walkers_;
    const std::int64_t own = block + (walkers_ + walker - turn) % walkers_;
    if (own == block) return row;
    return begins_[std::min<std::int64_t>(own, static_cast<std::int64_t>(begins_.size()) - 1)];
}

}  // namespace volsplat
