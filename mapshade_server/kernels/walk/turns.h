// Which walker takes which sheets and rows: in turns, so that all have as much to do without anything being measured.
#pragma once

#include <cstdint>
#include <vector>

#include "walk_plan.h"

namespace volsplat {

// Rows in traversal order are cut into blocks. Blocks are dealt out one after the other, sheet by sheet or from the
// first one again on every sheet.
class Turns {
public:
    // `sheets` and `rows` are how many the boxes hold; strips of columns are counted from `first_column` of the grid.
    Turns(const WalkPlan& plan, std::int64_t walkers, std::int64_t sheets, std::int64_t rows,
          std::int64_t first_column);

    // The first sheet from this one on, and of a sheet the first row from this one on, that the walker may have
    // something of. Beyond the last there are more.
    std::int64_t next_sheet(std::int64_t walker, std::int64_t sheet) const;
    std::int64_t next_row(std::int64_t walker, std::int64_t sheet, std::int64_t row) const;

    // The row after those of its block.
    std::int64_t block_end(std::int64_t row) const { return begins_[block_of_row_[row] + 1]; }

private:
    std::int64_t walkers_;
    bool whole_sheets_;
    std::int64_t blocks_for_each_sheet_;  // that the dealing moves on by from sheet to sheet
    std::vector<std::int64_t> begins_;    // of blocks, and the end of the last
    std::vector<std::int32_t> block_of_row_;
};

}  // namespace volsplat
