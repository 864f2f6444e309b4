// Plain structs that the splat loops of every instruction set share. No std header here: see CMakeLists.txt.
#pragma once
#include <stddef.h>
#include <stdint.h>

namespace volsplat {

constexpr int kSubpixelBits = 6;         // positions are multiples of 1/64 pixel (protocol/packet_layout.py)
constexpr int kPositionMask = (1 << 14) - 1;
constexpr int kOpacityShift = 28;
constexpr int kOpacityMask = (1 << 12) - 1;
constexpr int kColourShift = 40;
constexpr int kVectorPixels = 4;         // the widest vector of any path; an image row is a multiple of it
constexpr int kRowPadding = kVectorPixels - 1;
constexpr double kLargestHalfExtent = 16384;
constexpr float kFrozenAlpha = 1.0f - 1.0f / 1024.0f;  // front-to-back: from here on a pixel no longer changes

struct RowRun {  // 24 bytes on the wire
    uint32_t sheet, row, first, count;
    int32_t x0, y0;  // 1/64 pixel
};

struct SpanView {  // consecutive runs of one batch; the addresses need no alignment
    const unsigned char* runs;
    const unsigned char* packets;
    uint64_t run_count;
};

struct RowSpan {  // the non-zero weights of a row of the table
    uint16_t begin, end;
};

struct FootprintView {
    const float* weights;  // [fy][fx][row][pitch], each row between kRowPadding zeros
    const RowSpan* spans;  // [fy][fx][row]
    const int32_t* start_x;
    const int32_t* start_y;
    int offset_bits, width, height, pitch;
    bool clamped;  // some weight exceeds 1, so that min(1, w A) can bite
};

struct AxisView {  // protocol.traversal.AxisVisits
    int64_t low, high, stride, first, count;
    bool ascending;
};

struct CellView {  // the DDA over (sheet, row, sample), 2^-32 pixel for half a step (protocol/frame_plan.py)
    int64_t origin[2];
    int64_t half_step[2][3];  // of x and of y, along the sheet, row and sample axes
    AxisView axes[3];
};

enum class Reach { footprint, cell, pixel };

struct SplatJob {
    float* pixels;  // RGBA, associated; rows of `pitch` pixels, 64-byte aligned
    int64_t pitch;
    int width, row_begin, row_end;  // only image rows row_begin <= y < row_end are written
    const float* opacities;         // of the 4096 codes
    const SpanView* spans;
    size_t span_count;
    Reach reach;
    bool front_to_back;
    FootprintView footprint;
    CellView cell;
};

}  // namespace volsplat
