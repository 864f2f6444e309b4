// The splat loop: decode a packet, find its pixels and their weights, combine (paper: "Combining").
// Compiled once per instruction set. Every pixel sees the same IEEE operations in the same order whatever the
// vector width, the stripe and the other pixels, so all paths and thread counts give the same bits.
#include "splat_loops.h"

#ifdef __AVX2__
#include <immintrin.h>
#endif

#include "shaded_sample.h"
#include "sheet_cells.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

// Loads of one RGBA or weight into all the lanes of the path's vector. GCC builds these from its generic shuffles
// element by element, hence the intrinsics.
#if defined(__AVX512F__)
constexpr int kLanes = 4;  // RGBA pixels side by side
typedef __m512 Pixels;
constexpr __mmask16 kAll = 0xffff;  // GCC 12 warns about the undefined source of the unmasked forms

inline Pixels all_lanes(Sample4 p) { return _mm512_maskz_broadcast_f32x4(kAll, p); }
// kLanes weights, each spread over the four channels of its pixel.
inline Pixels weights_at(const float* w) {
    const __m512i spread = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
    return _mm512_maskz_permutexvar_ps(kAll, spread, _mm512_castps128_ps512(_mm_loadu_ps(w)));
}
inline Pixels alpha_of(Pixels c) { return _mm512_maskz_permute_ps(kAll, c, 0xff); }
#elif defined(__AVX2__)
constexpr int kLanes = 2;
typedef __m256 Pixels;

inline Pixels all_lanes(Sample4 p) { return _mm256_set_m128(p, p); }
inline Pixels weights_at(const float* w) {
    const __m256i spread = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1);
    const __m128 two = _mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(w)));
    return _mm256_permutevar8x32_ps(_mm256_castps128_ps256(two), spread);
}
inline Pixels alpha_of(Pixels c) { return _mm256_permute_ps(c, 0xff); }
#else
constexpr int kLanes = 1;
typedef Sample4 Pixels;

inline Pixels all_lanes(Sample4 p) { return p; }
inline Pixels weights_at(const float* w) { return Pixels{*w, *w, *w, *w}; }
inline Pixels alpha_of(Pixels c) { return Pixels{c[3], c[3], c[3], c[3]}; }
#endif

// The image buffer `c` with new points of opacity `a` and intensity `i` (whose fourth channel is 1).
template <bool kFrontToBack>
inline Pixels combined(Pixels c, Pixels a, Pixels i) {
    if constexpr (kFrontToBack) {
        const Pixels behind = alpha_of(c);
        const Pixels open = behind < kFrozenAlpha ? (1.0f - behind) * a : Pixels{};
        return c + open * i;
    } else {
        return c + a * (i - c);
    }
}

template <bool kFrontToBack, bool kClamped>
inline void combine_at(float* pixel, const float* weights, Pixels opacity, Pixels intensity) {
    Pixels c;
    __builtin_memcpy(&c, pixel, sizeof c);
    Pixels a = weights_at(weights) * opacity;
    if constexpr (kClamped) a = a < 1.0f ? a : Pixels{} + 1.0f;
    c = combined<kFrontToBack>(c, a, intensity);
    __builtin_memcpy(pixel, &c, sizeof c);
}

// Rows of kVectors vectors, wholly inside the image: the same few in every row, so that no branch is mispredicted.
template <bool kFrontToBack, bool kClamped, int kVectors>
inline void combine_box(float* pixels, int64_t row_stride, const float* weights, int64_t pitch, int64_t rows,
                        Pixels opacity, Pixels intensity) {
    for (; rows > 0; --rows, pixels += row_stride, weights += pitch)
#pragma GCC unroll 16
        for (int n = 0; n < kVectors; ++n)
            combine_at<kFrontToBack, kClamped>(pixels + n * kLanes * 4, weights + n * kLanes, opacity, intensity);
}

constexpr int kMostVectors = 9;

// The combine_box of `vectors`, 1..kMostVectors.
template <bool kFrontToBack, bool kClamped, int kVectors = 1>
inline void combine_box_of(int64_t vectors, float* pixels, int64_t row_stride, const float* weights, int64_t pitch,
                           int64_t rows, Pixels opacity, Pixels intensity) {
    if constexpr (kVectors < kMostVectors) {
        if (vectors > kVectors)
            return combine_box_of<kFrontToBack, kClamped, kVectors + 1>(vectors, pixels, row_stride, weights, pitch,
                                                                        rows, opacity, intensity);
    }
    combine_box<kFrontToBack, kClamped, kVectors>(pixels, row_stride, weights, pitch, rows, opacity, intensity);
}

template <bool kFrontToBack, bool kClamped>
void splat_footprints(const SplatJob& job) {
    const FootprintView& table = job.footprint;
    const int shift = kSubpixelBits - table.offset_bits;
    const int64_t half = shift ? int64_t(1) << (shift - 1) : 0;
    const int64_t fraction = (1 << table.offset_bits) - 1;
    const int64_t row_stride = job.pitch * 4;
    // A run's packets lie within 256 pixels of its origin, their footprints this much further.
    const int64_t reach = table.height + 2;
    for (size_t s = 0; s < job.span_count; ++s) {
        const unsigned char* packets = job.spans[s].packets;
        for (uint64_t r = 0; r < job.spans[s].run_count; ++r) {
            const RowRun run = run_at(job.spans[s].runs, r);
            const unsigned char* end = packets + uint64_t(run.count) * 8;
            const int64_t top = (int64_t(run.y0) >> kSubpixelBits) - reach;
            if (top >= job.row_end || top + 258 + 2 * reach < job.row_begin) {
                packets = end;
                continue;
            }
            for (; packets != end; packets += 8) {
                const ShadedSample sample = sample_at(packets, run, job.opacities);
                const int64_t qx = (sample.x + half) >> shift, qy = (sample.y + half) >> shift;
                const int64_t fx = qx & fraction, fy = qy & fraction;
                const int64_t left = (qx >> table.offset_bits) + table.start_x[fx];
                const int64_t first_row = (qy >> table.offset_bits) + table.start_y[fy];
                int64_t y_begin = first_row, y_end = first_row + table.height;
                if (y_begin < job.row_begin) y_begin = job.row_begin;
                if (y_end > job.row_end) y_end = job.row_end;
                if (y_begin >= y_end || left >= job.width || left + table.width <= 0) continue;
                const int64_t entry_row = ((fy << table.offset_bits) + fx) * table.height - first_row;
                const Pixels opacity = Pixels{} + sample.opacity;
                const Pixels intensity = all_lanes(sample.intensity);
                const int64_t whole = left & ~int64_t(kLanes - 1);
                const int64_t vectors = (left - whole + table.width + kLanes - 1) / kLanes;
                if (left >= 0 && left + table.width <= job.width && vectors <= kMostVectors) {
                    const float* weights =
                        table.weights + (entry_row + y_begin) * table.pitch + kRowPadding + whole - left;
                    combine_box_of<kFrontToBack, kClamped>(vectors, job.pixels + y_begin * row_stride + whole * 4,
                                                           row_stride, weights, table.pitch, y_end - y_begin,
                                                           opacity, intensity);
                    continue;
                }
                for (int64_t y = y_begin; y < y_end; ++y) {
                    const int64_t row = entry_row + y;
                    const RowSpan span = table.spans[row];
                    int64_t x = left + span.begin, x_end = left + span.end;
                    if (x < 0) x = 0;
                    if (x_end > job.width) x_end = job.width;
                    // Whole aligned vectors: neighbouring samples then reload exactly what was stored before.
                    x &= ~int64_t(kLanes - 1);
                    const float* weights = table.weights + row * table.pitch + kRowPadding - left;
                    float* pixels = job.pixels + y * row_stride;
                    for (; x < x_end; x += kLanes)
                        combine_at<kFrontToBack, kClamped>(pixels + x * 4, weights + x, opacity, intensity);
                }
            }
        }
    }
}

// One pixel, weight 1.
template <bool kFrontToBack>
inline void combine_whole(float* pixel, const ShadedSample& sample) {
    Sample4 c, i = sample.intensity;
    __builtin_memcpy(&c, pixel, sizeof c);
    if constexpr (kFrontToBack) {
        if (!(c[3] < kFrozenAlpha)) return;
        c = c + ((1.0f - c[3]) * sample.opacity) * i;
    } else {
        c = (1.0f - sample.opacity) * c + sample.opacity * i;
    }
    __builtin_memcpy(pixel, &c, sizeof c);
}

template <bool kFrontToBack>
void splat_nearest_pixels(const SplatJob& job) {
    for (size_t s = 0; s < job.span_count; ++s) {
        const unsigned char* packets = job.spans[s].packets;
        for (uint64_t r = 0; r < job.spans[s].run_count; ++r) {
            const RowRun run = run_at(job.spans[s].runs, r);
            for (uint32_t n = 0; n < run.count; ++n, packets += 8) {
                const ShadedSample sample = sample_at(packets, run, job.opacities);
                const int64_t half = 1 << (kSubpixelBits - 1);
                const int64_t x = (sample.x + half) >> kSubpixelBits, y = (sample.y + half) >> kSubpixelBits;
                if (x < 0 || x >= job.width || y < job.row_begin || y >= job.row_end) continue;
                combine_whole<kFrontToBack>(job.pixels + (y * job.pitch + x) * 4, sample);
            }
        }
    }
}

template <bool kFrontToBack>
void splat_cells(const SplatJob& job) {
    SheetCells cells(job.cell);
    if (cells.empty()) return;
    for (size_t s = 0; s < job.span_count; ++s) {
        const unsigned char* packets = job.spans[s].packets;
        for (uint64_t r = 0; r < job.spans[s].run_count; ++r) {
            const RowRun run = run_at(job.spans[s].runs, r);
            cells.enter_row(run.sheet, run.row);
            for (uint32_t n = 0; n < run.count; ++n, packets += 8) {
                const ShadedSample sample = sample_at(packets, run, job.opacities);
                if (!cells.enter_cell(sample.x, sample.y)) continue;
                int64_t y = cells.top(), y_end = cells.bottom();
                if (y < job.row_begin) y = job.row_begin;
                if (y_end > job.row_end) y_end = job.row_end;
                for (; y < y_end; ++y) {
                    int64_t x, x_end;
                    cells.pixels_of_row(y, job.width, x, x_end);
                    for (; x < x_end; ++x)
                        combine_whole<kFrontToBack>(job.pixels + (y * job.pitch + x) * 4, sample);
                }
            }
        }
    }
}

template <bool kFrontToBack>
void splat_in_order(const SplatJob& job) {
    if (job.reach == Reach::pixel)
        splat_nearest_pixels<kFrontToBack>(job);
    else if (job.reach == Reach::cell)
        splat_cells<kFrontToBack>(job);
    else if (job.footprint.clamped)
        splat_footprints<kFrontToBack, true>(job);
    else
        splat_footprints<kFrontToBack, false>(job);
}

}  // namespace

void splat(const SplatJob& job) {
    if (job.front_to_back)
        splat_in_order<true>(job);
    else
        splat_in_order<false>(job);
}

}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
