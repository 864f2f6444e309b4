// The vector instructions of the set that is being compiled.
#pragma once

#if defined(__AVX2__)
// GCC warns of intrinsics' deliberately undefined lanes.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#pragma GCC diagnostic pop
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif
