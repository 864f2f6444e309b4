// A block is shaded once no voxel can reach its planes any more.
#include "slab_planes.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "splat_server/kernels/paths/splat_kernels.h"

namespace volsplat {

namespace {

// Columns between lines: neighbours above each other must not share the few places of a cache that addresses a power of
// two apart have.
constexpr int kLineGap = 9;

int rounded_up(int number, int to) { return (number + to - 1) / to * to; }

bool frozen(float alpha) { return !(alpha < static_cast<float>(kFrozenAlpha)); }

}  // namespace

SlabPlanes::SlabPlanes(const SlabFrame& frame, const SplatJob& job)
    : frame_(frame),
      image_(job.image),
      row_begin_(job.row_begin),
      row_end_(job.row_end),
      work_(job.work),
      groups_((frame.planes - 1 + frame.lead) / kGroupPlanes + 1),
      number_bytes_(frame.table->sum_bytes()) {}

// Where nothing comes no memory is touched.
void SlabPlanes::make_room() {
    if (memory_) return;
    const int baseline = frame_.shading->baseline();
    sums_.margin = rounded_up(frame_.table->width() + baseline + 1, kTileColumns);
    sums_.tiles = rounded_up(image_.width + 2 * sums_.margin, kTileColumns) / kTileColumns;
    sums_.columns = sums_.tiles * kTileColumns;
    sums_.pitch = sums_.columns + kLineGap;
    sums_.first_line = row_begin_ - baseline;
    sums_.lines = row_end_ - row_begin_ + 2 * baseline;
    sums_.planes = frame_.table->planes();
    sums_.tile_rows = rounded_up(sums_.lines, kTileLines) / kTileLines;
    sums_.aside = baseline;
    const SlabTableView table = frame_.table->view();
    sums_.bias = table.bias, sums_.least = table.least;
    const std::size_t columns = static_cast<std::size_t>(sums_.pitch) * sums_.tile_rows * kTileLines;
    const std::size_t tiles = static_cast<std::size_t>(sums_.tile_rows) * sums_.tiles;
    memory_ = zeros(columns * sums_.planes * (number_bytes_ / sizeof(float)));
    sums_.sums = memory_.get();
    touched_.assign(sums_.planes / kBlockPlanes * tiles, 0);
    found_.patch_columns = (sums_.columns >> kPatchBits) + 1;
    patches_.assign(static_cast<std::size_t>(found_.patch_columns) * ((sums_.lines >> kPatchBits) + 1), 0);
    found_.patches = patches_.data();
    kept_.assign(columns * kKeptPlanes, 0);
    last_touched_.assign(tiles, 0);
}

std::uint64_t SlabPlanes::add(const SpanView* spans, std::size_t count) {
    clock_.start();
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
    clock_.lap(seconds_.adding);
    return hidden;
}

std::uint64_t SlabPlanes::add_runs(const SpanView& span, std::uint64_t begin, std::uint64_t end,
                                   const unsigned char* packets) {
    const std::int64_t group = run_at(span.runs, begin).sheet;
    if (group < next_block_ || group >= groups_) return 0;  // no voxel's of this frame
    if (group != group_) {
        add_group();
        clock_.lap(seconds_.adding);
        shade_before(group);
        group_ = group;
    }
    std::uint64_t more = 0;
    for (std::uint64_t n = begin; n < end; ++n) more += run_at(span.runs, n).count;
    if (voxels_.size() < found_.count + more) voxels_.resize(std::max(2 * voxels_.size(), found_.count + more));
    found_.voxels = voxels_.data();
    const SlabRuns runs{span.runs + begin * sizeof(RowRun), packets, end - begin};
    return splat_kernels().find_slab_voxels(frame_.table->view(), sums_, image_, runs, found_);
}

// Patch by patch.
void SlabPlanes::add_group() {
    std::uint32_t begin = 0;
    for (std::size_t n = 0; n < patches_.size(); ++n) {
        if (patches_[n] > 0) touch(n);
        begin += std::exchange(patches_[n], begin);
    }
    sorted_.resize(std::max<std::size_t>(sorted_.size(), found_.count));
    for (std::uint64_t n = 0; n < found_.count; ++n) {
        const SlabVoxel& voxel = voxels_[n];
        sorted_[patches_[patch_of(voxel.left, voxel.top, found_.patch_columns)]++] = voxel;
    }
    const SplatKernels& kernels = splat_kernels();
    const auto& splat = frame_.table->wide() ? kernels.splat_wide_slabs : kernels.splat_slabs;
    splat(frame_.table->view(), sums_, sorted_.data(), found_.count);
    std::fill(patches_.begin(), patches_.end(), 0);
    found_.count = 0;
}

// All tiles that boxes which begin in a patch may reach.
void SlabPlanes::touch(std::size_t patch) {
    const int left = static_cast<int>(patch % found_.patch_columns) << kPatchBits;
    const int top = static_cast<int>(patch / found_.patch_columns) << kPatchBits;
    const int right = left + (1 << kPatchBits) + frame_.table->width() - 2;  // the last column, and line
    const int bottom = top + (1 << kPatchBits) + frame_.table->height() - 2;
    const int first = left / kTileColumns, end = std::min(right / kTileColumns + 1, sums_.tiles);
    for (int block = 0; block < sums_.planes / kBlockPlanes; ++block)
        for (int row = top / kTileLines; row <= std::min(bottom / kTileLines, sums_.tile_rows - 1); ++row) {
            std::uint8_t* const tiles = touched_.data() + (block * sums_.tile_rows + row) * sums_.tiles;
            std::fill(tiles + first, tiles + end, 1);
        }
}

void SlabPlanes::finish() {
    if (!memory_) return;
    clock_.start();
    add_group();
    clock_.lap(seconds_.adding);
    shade_before((frame_.planes + frame_.lead) / kBlockPlanes + 1);
    let_go();
}

// Several times what the image takes, and the next frame may be hours away.
void SlabPlanes::let_go() {
    memory_.reset();
    std::vector<float>().swap(kept_);
    std::vector<SlabVoxel>().swap(voxels_);
    std::vector<SlabVoxel>().swap(sorted_);
}

void SlabPlanes::shade_before(std::int64_t block) {
    for (; next_block_ < block; ++next_block_) shade(next_block_);
}

// A row of tiles is shaded once the rows that gradients look at are densities, and moves on once no other row looks at
// it: what these steps share is still in a cache.
void SlabPlanes::shade(std::int64_t block) {
    const std::size_t tiles = last_touched_.size();
    std::vector<std::uint8_t> seen(tiles), all(tiles);  // the first slabs begin on planes of the block before
    for (std::size_t n = 0; n < tiles; ++n) all[n] = seen[n] = last_touched_[n] | touched_[n];
    for (std::size_t n = tiles; n < touched_.size(); ++n) all[n % tiles] |= touched_[n];
    const int ahead = rounded_up(sums_.aside, kTileLines) / kTileLines;
    for (int row = 0; row < sums_.tile_rows + 2 * ahead; ++row) {
        each_tile(touched_.data(), row, [&](int tile) { find_densities(row, tile); });
        clock_.lap(seconds_.densities);
        each_tile(seen.data(), row - ahead, [&](int tile) { shade_tile(block, row - ahead, tile); });
        clock_.lap(seconds_.shading);
        each_tile(all.data(), row - 2 * ahead, [&](int tile) { move_on(row - 2 * ahead, tile); });
        clock_.lap(seconds_.densities);
    }
    std::copy_n(touched_.begin(), tiles, last_touched_.begin());
    std::copy(touched_.begin() + tiles, touched_.end(), touched_.begin());
    std::fill(touched_.end() - tiles, touched_.end(), 0);
}

SlabSeconds SlabPlanes::seconds() const {
    SlabSeconds found = seconds_;
    const double sampled = shading_sampled_ + compositing_sampled_;
    found.compositing = sampled > 0 ? seconds_.shading * (compositing_sampled_ / sampled) : 0;
    found.shading -= found.compositing;
    return found;
}

template <class Do>
void SlabPlanes::each_tile(const std::uint8_t* marks, int row, const Do& act) const {
    if (row < 0 || row >= sums_.tile_rows) return;
    for (int tile = 0; tile < sums_.tiles; ++tile)
        if (marks[row * sums_.tiles + tile]) act(tile);
}

void SlabPlanes::find_densities(int row, int tile) {
    const SplatKernels& kernels = splat_kernels();
    const auto& find = frame_.table->wide() ? kernels.find_wide_slab_densities : kernels.find_slab_densities;
    for (int line = row * kTileLines; line < (row + 1) * kTileLines; ++line)
        find(sums_, planes_at(line, tile * kTileColumns), kTileColumns);
}

SlabPlanes::TileArea SlabPlanes::area_of(int row, int tile) const {
    return {std::max(tile * kTileColumns - sums_.margin, 0),
            std::min((tile + 1) * kTileColumns - sums_.margin, image_.width), std::max(row * kTileLines, sums_.aside),
            std::min((row + 1) * kTileLines, sums_.lines - sums_.aside)};
}

void SlabPlanes::shade_tile(std::int64_t block, int row, int tile) {
    const TileArea area = area_of(row, tile);
    ShownPixels shown;
    if (area.left >= area.right) return;
    tile_clock_.start();
    const bool any = find_shown(block, area, shown);
    tile_clock_.lap(shading_sampled_);
    if (!any) return;
    for (int slab = 0; slab < kBlockPlanes; ++slab)
        if (shown.counts[slab] > 0) shade_slab(block, slab, area, shown);
    note_closed(area);
    tile_clock_.lap(compositing_sampled_);
}

// False if none are.
bool SlabPlanes::find_shown(std::int64_t block, const TileArea& area, ShownPixels& shown) const {
    const SlabShadingView shading = frame_.shading->view();
    const Plane kept = plane(-kKeptPlanes), first = plane(0);
    const std::int64_t before_slab_0 = first_slab(block);
    const auto begin = std::clamp<std::int64_t>(-before_slab_0, 0, kBlockPlanes);
    const auto end = std::clamp<std::int64_t>(frame_.planes - 1 - before_slab_0, 0, kBlockPlanes);
    shown.counts = {};
    bool any = false;
    for (int line = area.top; line < area.bottom; ++line) {
        const SlabDensities densities{kept.densities + line * kept.down + area.left * kept.right,
                                      first.densities + line * first.down + area.left * first.right, first.right};
        std::uint8_t marks[kTileColumns][kBlockPlanes];
        splat_kernels().find_shown_slabs(shading, densities, area.right - area.left, marks);
        const float* const alphas =
            image_.pixels + (line + sums_.first_line) * image_.pitch + area.left + 3 * image_.plane;
        for (int n = 0; n < area.right - area.left; ++n) {
            std::uint64_t all;
            std::memcpy(&all, marks[n], sizeof all);
            if (all == 0 || frozen(alphas[n])) continue;
            const auto pixel = static_cast<std::uint16_t>((line - area.top) * kTileColumns + n);
            // Written either way, to be overwritten: which it is cannot be guessed
            for (auto slab = begin; slab < end; ++slab) {
                shown.pixels[slab][shown.counts[slab]] = pixel;
                shown.counts[slab] += marks[n][slab];
            }
            any = true;
        }
    }
    return any;
}

void SlabPlanes::shade_slab(std::int64_t block, int slab, const TileArea& area, const ShownPixels& shown) {
    const Plane planes[] = {plane(slab - 2), plane(slab - 1)}, next[] = {plane(slab - 3), plane(slab)};
    float* const pixels = image_.pixels + (area.top + sums_.first_line) * image_.pitch + area.left;
    const auto pixel_at = [&](int n) {
        return pixels + shown.pixels[slab][n] / kTileColumns * image_.pitch + shown.pixels[slab][n] % kTileColumns;
    };
    samples_.count = 0;
    samples_.slab = first_slab(block) + slab;
    float* open[kTilePixels];
    for (int n = 0; n < shown.counts[slab]; ++n) {
        float* const pixel = pixel_at(n);
        if (frozen(pixel[3 * image_.plane])) continue;
        const int line = area.top + shown.pixels[slab][n] / kTileColumns;
        const int x = area.left + shown.pixels[slab][n] % kTileColumns, at = samples_.count++;
        open[at] = pixel;
        samples_.x[at] = x, samples_.y[at] = line + sums_.first_line;
        for (int side = 0; side < 2; ++side) {
            const Plane& plane = planes[side];
            const float* const here = plane.densities + line * plane.down + x * plane.right;
            const std::int64_t right = sums_.aside * plane.right, down = sums_.aside * plane.down;
            samples_.here[side][at] = *here;
            samples_.next[side][at] = next[side].densities[line * next[side].down + x * next[side].right];
            samples_.beside[side][0][at] = here[-right];
            samples_.beside[side][1][at] = here[right];
            samples_.beside[side][2][at] = here[-down];
            samples_.beside[side][3][at] = here[down];
        }
    }
    splat_kernels().find_slab_colours(frame_.shading->view(), samples_);
    tile_clock_.lap(shading_sampled_);
    for (int n = 0; n < samples_.count; ++n) {
        float* const pixel = open[n];
        float& alpha = pixel[3 * image_.plane];
        const float* const found = samples_.found[n];
        const float visible = (1.0f - alpha) * found[3];
        for (int channel = 0; channel < 3; ++channel) pixel[channel * image_.plane] += visible * found[channel];
        alpha += visible;
    }
    tile_clock_.lap(compositing_sampled_);
}

// Others read the map meanwhile; only the region's owner writes to its rows.
void SlabPlanes::note_closed(const TileArea& area) {
    const int top = area.top + sums_.first_line, bottom = area.bottom + sums_.first_line;
    const auto closed = [&](int column, int row) {
        const int x_end = std::min((column + 1) * kTileSide, image_.width);
        const int y_end = std::min((row + 1) * kTileSide, row_end_);
        for (int y = row * kTileSide; y < y_end; ++y) {
            const float* const alphas = image_.pixels + y * image_.pitch + 3 * image_.plane;
            for (int x = column * kTileSide; x < x_end; ++x)
                if (!frozen(alphas[x])) return false;
        }
        return true;
    };
    for (int row = top / kTileSide; row <= (bottom - 1) / kTileSide; ++row)
        for (int column = area.left / kTileSide; column <= (area.right - 1) / kTileSide; ++column) {
            std::uint64_t& word = image_.closed_tiles[row * image_.tile_words + column / kWordTiles];
            const std::uint64_t bit = std::uint64_t{1} << column % kWordTiles;
            if ((word & bit) || !closed(column, row)) continue;
            __atomic_store_n(&word, word | bit, __ATOMIC_RELAXED);
            sums_.any_closed = true;
        }
}

void SlabPlanes::move_on(int row, int tile) {
    if (frame_.table->wide()) move_on<std::uint64_t>(row, tile);
    else move_on<std::uint32_t>(row, tile);
}

// Keeps the last planes of the block that was shaded, and has the next one take its place.
template <class Number>
void SlabPlanes::move_on(int row, int tile) {
    constexpr std::size_t kBlock = kBlockPlanes * sizeof(Number);
    const std::size_t all = sums_.planes * sizeof(Number);
    for (int line = row * kTileLines; line < (row + 1) * kTileLines; ++line) {
        char* at = planes_at(line, tile * kTileColumns);
        float* kept = kept_.data() + (line * sums_.pitch + tile * kTileColumns) * kKeptPlanes;
        for (int n = 0; n < kTileColumns; ++n, at += all, kept += kKeptPlanes) {
            std::memcpy(kept, at + (kBlockPlanes - kKeptPlanes) * sizeof(float), kKeptPlanes * sizeof(float));
            for (std::size_t block = kBlock; block < all; block += kBlock)
                std::memcpy(at + block - kBlock, at + block, kBlock);
            std::memset(at + all - kBlock, 0, kBlock);
        }
    }
}

// The first slab that a block completes, which begins two planes before it.
std::int64_t SlabPlanes::first_slab(std::int64_t block) const { return kBlockPlanes * block - frame_.lead - 2; }

// From pixel 0 of line 0 on; those before number 0 are the last of the block before.
SlabPlanes::Plane SlabPlanes::plane(int number) const {
    if (number < 0) {
        const float* const kept = kept_.data() + sums_.margin * kKeptPlanes + kKeptPlanes + number;
        return {kept, kKeptPlanes, static_cast<std::int64_t>(sums_.pitch) * kKeptPlanes};
    }
    const auto* const densities = reinterpret_cast<const float*>(planes_at(0, sums_.margin)) + number;
    const auto right = static_cast<std::int64_t>(sums_.planes * number_bytes_ / sizeof(float));
    return {densities, right, sums_.pitch * right};
}

char* SlabPlanes::planes_at(int line, int column) const {
    const std::int64_t place = (line * sums_.pitch + column) * sums_.planes;
    return static_cast<char*>(sums_.sums) + place * static_cast<std::int64_t>(number_bytes_);
}

}  // namespace volsplat
