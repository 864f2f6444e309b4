// The floor of bench_splat.py: the same weighted adds to the same pixels with everything else taken away.
#include <cstdint>

// Back to front, one constant sample; `corners` are the first pixels of boxes of `side` x `side`.
extern "C" void bare_splat(float* image, int64_t pitch, const int32_t* corners, int64_t count, int side,
                           const float* weights, const float* sample) {
    typedef float Row __attribute__((vector_size(VECTOR_BYTES)));
    constexpr int kLanes = VECTOR_BYTES / 16;
    Row colour;
    for (int n = 0; n < 4 * kLanes; ++n) colour[n] = sample[n % 4];
    for (int64_t s = 0; s < count; ++s) {
        const float* weight = weights;
        for (int y = 0; y < side; ++y) {
            float* pixel = image + ((corners[2 * s + 1] + y) * pitch + corners[2 * s]) * 4;
            for (int x = 0; x < side; x += kLanes, pixel += 4 * kLanes, weight += 4 * kLanes) {
                Row c, w;
                __builtin_memcpy(&c, pixel, sizeof c);
                __builtin_memcpy(&w, weight, sizeof w);
                c = c + w * (colour - c);
                __builtin_memcpy(pixel, &c, sizeof c);
            }
        }
    }
}
