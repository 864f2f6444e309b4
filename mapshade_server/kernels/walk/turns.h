// Which walker takes which rows: in turns, so that all have as much to do without anything being measured.
#pragma once

#include <cstdint>
#include <vector>

#include "walk_plan.h"

namespace volsplat {

// Rows in traversal order are cut into blocks, which are dealt out sheet by sheet: all walkers are at about the same
// depth, and a merge seldom changes from one to the other.
class Turns {
public:
    // `sheets` and `rows` are how many the boxes hold; strips of columns are counted from `first_column` of the grid.
    Turns(const WalkPlan& plan, std::int64_t walkers, std::int64_t sheets, std::int64_t rows,
          std::int64_t first_column);

    std::int64_t walkers() const { return walkers_; }

    // The first row of the sheet from this one on that is the walker's; if there is none, that after the last.
    std::int64_t next_row(std::int64_t walker, std::int64_t sheet, std::int64_t row) const;
    std::int64_t rows() const { return begins_.back(); }

    // The row after those of its block.
    std::int64_t block_end(std::int64_t row) const { return begins_[block_of_row_[row] + 1]; }

    // Some rows on, a power of two, a walker is mostly at a row so many times as far away.
    std::int64_t spread() const { return spread_; }

private:
    std::int64_t walkers_;
    std::int64_t sheet_step_;  // walkers that the dealing moves on by from sheet to sheet
    std::int64_t spread_;
    std::vector<std::int64_t> begins_;  // of blocks, and the end of the last
    std::vector<std::int32_t> block_of_row_;
};

}  // namespace volsplat
