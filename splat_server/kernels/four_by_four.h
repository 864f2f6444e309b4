// Four pixels of four channels turned: from channel by channel to pixel by pixel, or back.
#pragma once

namespace volsplat {
namespace {  // every instruction set has its own

typedef float FourFloats __attribute__((vector_size(16)));

__attribute__((always_inline)) inline void transpose(FourFloats (&rows)[4]) {
    typedef int Places __attribute__((vector_size(16)));
    const Places low = {0, 4, 1, 5}, high = {2, 6, 3, 7}, first = {0, 1, 4, 5}, second = {2, 3, 6, 7};
    const FourFloats low01 = __builtin_shuffle(rows[0], rows[1], low), low23 = __builtin_shuffle(rows[2], rows[3], low);
    const FourFloats high01 = __builtin_shuffle(rows[0], rows[1], high);
    const FourFloats high23 = __builtin_shuffle(rows[2], rows[3], high);
    rows[0] = __builtin_shuffle(low01, low23, first), rows[1] = __builtin_shuffle(low01, low23, second);
    rows[2] = __builtin_shuffle(high01, high23, first), rows[3] = __builtin_shuffle(high01, high23, second);
}

}  // namespace
}  // namespace volsplat
