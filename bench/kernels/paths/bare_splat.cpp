// The splat kernel's floor: fused weighted adds of one constant sample to boxes of RGBA pixels, back to front.
#include "bare_loops.h"
#include "kernels/compiler.h"

namespace volsplat::VOLSPLAT_PATH {

#if defined(__AVX512F__)
typedef float Row __attribute__((vector_size(64)));
#elif defined(__AVX2__)
typedef float Row __attribute__((vector_size(32)));
#else
typedef float Row __attribute__((vector_size(16)));
#endif

template <int kSide>
static void splat_boxes(float* image, std::int64_t pitch, const std::int32_t* corners, std::int64_t count,
                        const float* weights, const float* sample) {
    constexpr int kFloats = sizeof(Row) / 4;
    Row colour;
    for (int n = 0; n < kFloats; ++n) colour[n] = sample[n % 4];
    for (std::int64_t s = 0; s < count; ++s) {
        float* pixel = image + (corners[2 * s + 1] * pitch + corners[2 * s]) * 4;
        const float* weight = weights;
        for (int y = 0; y < kSide; ++y, pixel += pitch * 4, weight += kSide * 4) VOLSPLAT_UNROLL(16)
        for (int x = 0; x < kSide * 4; x += kFloats) {
            Row c, w;
            __builtin_memcpy(&c, pixel + x, sizeof c);
            __builtin_memcpy(&w, weight + x, sizeof w);
            c += w * (colour - c);
            __builtin_memcpy(pixel + x, &c, sizeof c);
        }
    }
}

void bare_splat(float* image, std::int64_t pitch, const std::int32_t* corners, std::int64_t count, int side,
                const float* weights, const float* sample) {
    if (side == 4) splat_boxes<4>(image, pitch, corners, count, weights, sample);
    if (side == 8) splat_boxes<8>(image, pitch, corners, count, weights, sample);
    if (side == 12) splat_boxes<12>(image, pitch, corners, count, weights, sample);
    if (side == 16) splat_boxes<16>(image, pitch, corners, count, weights, sample);
}

}  // namespace volsplat::VOLSPLAT_PATH
