// Which places on a line lie between bounds, by integers.
#pragma once

#include <algorithm>
#include <cstdint>

namespace volsplat {

inline std::int64_t floor_divided(std::int64_t a, std::int64_t b) {
    const std::int64_t quotient = a / b;
    return quotient * b != a && (a < 0) != (b < 0) ? quotient - 1 : quotient;
}

// Narrows begin..end to the n with low <= start + n * step <= high.
inline void narrow(std::int64_t start, std::int64_t step, std::int64_t low, std::int64_t high, std::int64_t& begin,
                   std::int64_t& end) {
    if (step == 0) {
        if (start < low || start > high) end = begin;
        return;
    }
    // Most rows lie within
    const std::int64_t first = start + begin * step, last = start + (end - 1) * step;
    if (std::min(first, last) >= low && std::max(first, last) <= high) return;
    if (step < 0) std::swap(low, high);
    begin = std::max(begin, -floor_divided(start - low, step));
    end = std::min(end, floor_divided(high - start, step) + 1);
}

}  // namespace volsplat
