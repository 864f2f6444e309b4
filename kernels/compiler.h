// What is said to the compiler beside C++: GCC and Clang understand it.
#pragma once

// A function that files of several instruction sets share: the linker must not keep one copy for all (path_table.h).
#define VOLSPLAT_INLINE __attribute__((always_inline)) inline

// Before a loop: it is unrolled so many times; no round of it reads what another one writes.
#define VOLSPLAT_PRAGMA(words) _Pragma(#words)
#if defined(__clang__)
#define VOLSPLAT_UNROLL(times) VOLSPLAT_PRAGMA(clang loop unroll_count(times))
#define VOLSPLAT_INDEPENDENT VOLSPLAT_PRAGMA(clang loop vectorize(assume_safety))
#else
#define VOLSPLAT_UNROLL(times) VOLSPLAT_PRAGMA(GCC unroll times)
#define VOLSPLAT_INDEPENDENT VOLSPLAT_PRAGMA(GCC ivdep)
#endif
