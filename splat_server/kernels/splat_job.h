// Plain structs that the splat loops of every instruction set share.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/axis_visits.h"
#include "kernels/packet_layout.h"
#include "kernels/rounding.h"
#include "kernels/tile_map.h"

namespace volsplat {

constexpr int kRunPixels = 1 << (kPositionBits - kSubpixelBits);  // a run's packets lie so near to its origin
constexpr double kLargestHalfExtent = 16384;

// Footprints of up to so many pixels a row are splatted as one box of whole vectors, and of a wide one each row as far
// as the footprint may reach there.
constexpr int kNarrowBox = 16, kWideBox = 32;
// An image's rows are so much longer on either side: what a box writes there is never shown.
constexpr int kMarginPixels = kWideBox;
// So many floats on either side of a footprint table may be read.
constexpr int kWeightMargin = 16;

struct SpanView {  // consecutive runs of one batch; the addresses need no alignment
    const unsigned char* runs;
    const unsigned char* packets;
    std::uint64_t run_count;
};

struct RowSpan {  // pixels of a row, or rows
    std::int32_t begin, end;
};

struct FootprintView {
    const float* weights;  // [fy][fx][height][pitch], zeros from the width on; see kWeightMargin
    const RowSpan* spans;  // [height]: what may be above zero at some offset
    // The box of offset f begins at pixel `start`, from offset `step` on one later.
    int start_x, step_x, start_y, step_y;
    int offset_bits, width, height, pitch;
    bool clamped;  // some weight may exceed 1, so that min(1, w A) can bite
};

struct CellAxis {
    AxisVisits visits;
    bool ascending;
};

struct CellView {  // the DDA over (sheet, row, sample), 2^-32 pixel for half a step (protocol/rules/frame_plan.py)
    std::int64_t origin[2];
    std::int64_t half_step[2][3];  // of x and of y, along the sheet, row and sample axes
    CellAxis axes[3];
};

enum class Reach { footprint, cell, pixel, slabs };

struct SlabFrame;  // see regions/slab_planes.h

struct ImageView {
    float* pixels;              // red of the top-left pixel
    std::int64_t plane, pitch;  // floats from one channel to the next, and from one row to the next
    int width, height;
    std::uint64_t* closed_tiles;  // rows of `tile_words`, with one more word after the last
    std::int64_t tile_words;
};

// All samples, into the rows row_begin <= y < row_end; these are multiples of kTileSide, or the image's end.
struct SplatJob {
    ImageView image;
    int row_begin, row_end;
    const float* opacities;  // of the 4096 codes
    const SpanView* spans;
    std::size_t span_count;
    Reach reach;
    bool front_to_back;
    float frozen_alpha;  // front to back: from here on a pixel no longer changes
    FootprintView footprint;
    Thresholds thresholds;  // of its offsets
    CellView cell;
    const SlabFrame* slabs;
    std::int64_t unseen_pixels;  // splatted to since it was last looked which tiles have become closed
    std::uint64_t* work;         // of each row of tiles of the image: counts the packets whose run's middle lies there
};

struct SplatOutcome {
    int row_begin, row_end;  // of the rows that may have changed
    std::uint64_t hidden;    // packets left out as hidden whose first row lies here; another region may still draw them
    std::int64_t unseen_pixels;
};

}  // namespace volsplat
