// A slab is shaded once no voxel can reach its two planes any more.
#include "slab_planes.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "splat_server/kernels/paths/splat_kernels.h"

namespace volsplat {

namespace {

// Of what the weights around a point sum to: less is known only outside of the volume, and deep in no data.
constexpr double kLeastKnown = 1.0 / 16;
constexpr double kParallel = 1e-12;

template <class Number>
bool density_of(Number sum, float& density) {
    typedef SumLayout<Number> Layout;
    typedef typename Layout::Quotient Quotient;
    typedef std::make_signed_t<Number> Signed;  // which instruction sets convert
    constexpr Signed kLeast = static_cast<Signed>(kLeastKnown * Layout::kUnit);
    const Signed weight = static_cast<Signed>(sum >> Layout::kDensityBits);
    const Signed weighted = static_cast<Signed>(sum & ((Number{1} << Layout::kDensityBits) - 1));
    density = static_cast<float>(static_cast<Quotient>(weighted) / static_cast<Quotient>(std::max<Signed>(weight, 1)));
    return weight >= kLeast;
}

int rounded_up(int number, int to) { return (number + to - 1) / to * to; }

}  // namespace

SlabPlanes::SlabPlanes(const SlabFrame& frame, const SplatJob& job)
    : frame_(frame), image_(job.image), row_begin_(job.row_begin), row_end_(job.row_end), work_(job.work) {}

// Where nothing comes no memory is touched.
void SlabPlanes::make_room() {
    if (memory_) return;
    const SlabTableView table = frame_.table->view();
    const int aside = table.pitch + frame_.baseline + kSliceLanes, lines = row_end_ - row_begin_ + 2 * frame_.baseline;
    sums_.margin = rounded_up(aside, kSliceLanes);
    sums_.pitch = rounded_up(image_.width + 2 * sums_.margin, kTileColumns);
    sums_.first_line = row_begin_ - frame_.baseline;
    sums_.lines = lines;
    sums_.plane = sums_.pitch * lines;
    sums_.ring = kGroupPlanes + table.slices + 2;
    sums_.planes = frame_.planes;
    sums_.tile_rows = rounded_up(lines, kTileLines) / kTileLines;
    sums_.tiles = static_cast<int>(sums_.pitch / kTileColumns);
    const std::size_t numbers = static_cast<std::size_t>(sums_.ring) * sums_.plane;
    memory_ = zeros(frame_.table->wide() ? 2 * numbers : numbers);
    sums_.sums = memory_.get();
    touched_.assign(static_cast<std::size_t>(sums_.ring) * sums_.tile_rows * sums_.tiles, 0);
    sums_.touched = touched_.data();
    sums_.aside = frame_.baseline;
}

std::uint64_t SlabPlanes::add(const SpanView* spans, std::size_t count) {
    make_room();
    std::uint64_t hidden = 0;
    for (const SpanView* span = spans; span != spans + count; ++span) {
        const unsigned char* packets = span->packets;
        for (std::uint64_t begin = 0; begin < span->run_count;) {
            const std::uint32_t group = run_at(span->runs, begin).sheet;
            std::uint64_t end = begin, all = 0;
            for (; end < span->run_count; ++end) {
                const RowRun run = run_at(span->runs, end);
                if (run.sheet != group) break;
                const std::int64_t line = std::clamp<std::int64_t>(run.y0 >> kSubpixelBits, row_begin_, row_end_ - 1);
                work_[line / kTileSide] += run.count;
                all += run.count;
            }
            hidden += add_runs(*span, begin, end, packets);
            packets += all * kPacketBytes;
            begin = end;
        }
    }
    return hidden;
}

std::uint64_t SlabPlanes::add_runs(const SpanView& span, std::uint64_t begin, std::uint64_t end,
                                   const unsigned char* packets) {
    const std::int64_t group = run_at(span.runs, begin).sheet;
    const std::int64_t first = kGroupPlanes * group - frame_.lead;
    shade_before(first - 1);
    const SlabRuns runs{span.runs + begin * sizeof(RowRun), packets, end - begin, first + frame_.before};
    const SlabTableView table = frame_.table->view();
    if (frame_.table->wide()) return splat_kernels().splat_wide_slabs(table, sums_, image_, runs);
    return splat_kernels().splat_slabs(table, sums_, image_, runs);
}

void SlabPlanes::finish() {
    if (memory_) shade_before(frame_.planes - 1);
}

// The slabs whose second plane lies before this one, or is it.
void SlabPlanes::shade_before(std::int64_t plane) {
    for (; next_slab_ < std::min<std::int64_t>(plane, frame_.planes - 1); ++next_slab_) shade(next_slab_);
}

void SlabPlanes::shade(std::int64_t slab) {
    const std::uint8_t *front = touched(slab), *back = touched(slab + 1);
    for (int row = 0; row < sums_.tile_rows; ++row)
        for (int tile = 0; tile < sums_.tiles; ++tile, ++front, ++back)
            if (*front | *back) shade_tile(slab, row, tile);
    clear(slab);
}

void SlabPlanes::shade_tile(std::int64_t slab, int row, int tile) {
    const int left = std::max(tile * kTileColumns - sums_.margin, 0);
    const int right = std::min((tile + 1) * kTileColumns - sums_.margin, image_.width);
    const int top = std::max(row * kTileLines, frame_.baseline);
    const int bottom = std::min((row + 1) * kTileLines, sums_.lines - frame_.baseline);
    if (left >= right) return;
    Densities front, back;
    bool shaded = false;
    for (int line = top; line < bottom; ++line) {
        densities(slab, left, right - left, line, front);
        densities(slab + 1, left, right - left, line, back);
        for (int n = 0; n < right - left; ++n) {
            const bool known[2] = {front.known[n], back.known[n]};
            if (!known[0] && !known[1]) continue;
            const float found[2] = {known[0] ? front.density[n] : back.density[n],
                                    known[1] ? back.density[n] : front.density[n]};
            if (!frame_.shading->shows(std::min(found[0], found[1]), std::max(found[0], found[1]))) continue;
            shade_pixel(slab, left + n, line, found, known);
            shaded = true;
        }
    }
    if (shaded) note_closed(left, right, top + sums_.first_line, bottom + sums_.first_line);
}

// Others read the map meanwhile; only the region's owner writes to its rows.
void SlabPlanes::note_closed(int left, int right, int top, int bottom) {
    const auto frozen = [&](int column, int row) {
        const int x_end = std::min((column + 1) * kTileSide, image_.width);
        const int y_end = std::min((row + 1) * kTileSide, row_end_);
        for (int y = row * kTileSide; y < y_end; ++y) {
            const float* const alphas = image_.pixels + y * image_.pitch + 3 * image_.plane;
            for (int x = column * kTileSide; x < x_end; ++x)
                if (alphas[x] < static_cast<float>(kFrozenAlpha)) return false;
        }
        return true;
    };
    for (int row = top / kTileSide; row <= (bottom - 1) / kTileSide; ++row)
        for (int column = left / kTileSide; column <= (right - 1) / kTileSide; ++column) {
            std::uint64_t& word = image_.closed_tiles[row * image_.tile_words + column / kWordTiles];
            const std::uint64_t bit = std::uint64_t{1} << column % kWordTiles;
            if ((word & bit) || !frozen(column, row)) continue;
            __atomic_store_n(&word, word | bit, __ATOMIC_RELAXED);
            sums_.any_closed = true;
        }
}

void SlabPlanes::shade_pixel(std::int64_t slab, int x, int line, const float (&densities)[2], const bool (&known)[2]) {
    const int y = line + sums_.first_line;
    float* const pixel = image_.pixels + y * image_.pitch + x;
    float& alpha = pixel[3 * image_.plane];
    if (!(alpha < static_cast<float>(kFrozenAlpha))) return;
    double from, to;
    if (!clip(slab, x, y, from, to)) return;
    const double rise = densities[1] - densities[0], middle = (from + to) / 2;
    SlabSample sample{densities[0] + (from - slab) * rise,
                      densities[0] + (to - slab) * rise,
                      (to - from) * frame_.thickness,
                      gradient(slab, x, line, densities, known),
                      {}};
    for (int axis = 0; axis < 3; ++axis)
        sample.place[axis] =
            frame_.origin[axis] + x * frame_.right[axis] + y * frame_.down[axis] + middle * frame_.behind[axis];
    const SlabColour shaded = frame_.shading->shade(sample);
    const float visible = (1.0f - alpha) * static_cast<float>(shaded.opacity);
    for (int channel = 0; channel < 3; ++channel)
        pixel[channel * image_.plane] += visible * static_cast<float>(shaded.colour[channel]);
    alpha += visible;
}

// The part of a slab within the bounds, in planes; false if there is none.
bool SlabPlanes::clip(std::int64_t slab, int x, int y, double& from, double& to) const {
    from = static_cast<double>(slab), to = from + 1;
    for (int axis = 0; axis < 3; ++axis) {
        const double start = frame_.origin[axis] + x * frame_.right[axis] + y * frame_.down[axis];
        const double step = frame_.behind[axis];
        if (std::abs(step) < kParallel) {
            if (start < frame_.low[axis] || start > frame_.high[axis]) return false;
            continue;
        }
        const double low = (frame_.low[axis] - start) / step, high = (frame_.high[axis] - start) / step;
        from = std::max(from, std::min(low, high));
        to = std::min(to, std::max(low, high));
    }
    return from < to;
}

// Central differences in the middle of the slab; where a neighbour is not known, one-sided ones.
Vector3 SlabPlanes::gradient(std::int64_t slab, int x, int line, const float (&densities)[2],
                             const bool (&known)[2]) const {
    Vector3 sum{0, 0, known[0] && known[1] ? densities[1] - densities[0] : 0.0};
    const int aside = frame_.baseline, planes = int(known[0]) + int(known[1]);
    for (int side = 0; side < 2; ++side) {
        if (!known[side]) continue;
        for (int axis = 0; axis < 2; ++axis) {
            const int dx = axis == 0 ? aside : 0, dy = axis == 0 ? 0 : aside;
            float low = 0, high = 0;
            const bool before = density(slab + side, x - dx, line - dy, low);
            const bool after = density(slab + side, x + dx, line + dy, high);
            const double rise = (after ? high : densities[side]) - (before ? low : densities[side]);
            if (before || after) sum[axis] += rise / (aside * (int(before) + int(after)) * planes);
        }
    }
    return sum;
}

bool SlabPlanes::density(std::int64_t plane, int x, int line, float& found) const {
    const std::int64_t at = place(plane, x, line);
    return frame_.table->wide() ? density_of(static_cast<const std::uint64_t*>(sums_.sums)[at], found)
                                : density_of(static_cast<const std::uint32_t*>(sums_.sums)[at], found);
}

void SlabPlanes::densities(std::int64_t plane, int x, int count, int line, Densities& found) const {
    const std::int64_t at = place(plane, x, line);
    const auto read = [&](const auto* sums) {
        for (int n = 0; n < count; ++n) found.known[n] = density_of(sums[at + n], found.density[n]);
    };
    if (frame_.table->wide()) read(static_cast<const std::uint64_t*>(sums_.sums));
    else read(static_cast<const std::uint32_t*>(sums_.sums));
}

void SlabPlanes::clear(std::int64_t plane) {
    std::uint8_t* tiles = touched(plane);
    const std::size_t bytes = frame_.table->wide() ? sizeof(std::uint64_t) : sizeof(std::uint32_t);
    char* const sums = static_cast<char*>(sums_.sums) + (plane % sums_.ring) * sums_.plane * bytes;
    for (int row = 0; row < sums_.tile_rows; ++row)
        for (int tile = 0; tile < sums_.tiles; ++tile, ++tiles) {
            if (!std::exchange(*tiles, 0)) continue;
            const int end = std::min((row + 1) * kTileLines, sums_.lines);
            for (int line = row * kTileLines; line < end; ++line)
                std::memset(sums + (line * sums_.pitch + tile * kTileColumns) * bytes, 0, kTileColumns * bytes);
        }
}

std::uint8_t* SlabPlanes::touched(std::int64_t plane) const {
    return sums_.touched + (plane % sums_.ring) * sums_.tile_rows * sums_.tiles;
}

std::int64_t SlabPlanes::place(std::int64_t plane, int x, int line) const {
    return (plane % sums_.ring) * sums_.plane + line * sums_.pitch + sums_.margin + x;
}

}  // namespace volsplat
