// Powers that are the same bits on every machine: IEEE additions, multiplications and divisions only, no libm. Written
// without branches, so that the compiler makes vectors of loops over them.
#pragma once

#include <cstdint>

#include "kernels/compiler.h"

namespace volsplat::VOLSPLAT_PATH {

inline std::uint64_t bits_of(double x) { return __builtin_bit_cast(std::uint64_t, x); }
inline double double_of(std::uint64_t bits) { return __builtin_bit_cast(double, bits); }

// The logarithm to base 2 of a positive, finite number; relative error below 1e-15.
inline double log2_exactly(double x) {
    constexpr double kLog2E = 1.44269504088896340736;
    constexpr double kRootHalf = 0.70710678118654752440;
    constexpr double kTwoTo54 = 18014398509481984.0;
    constexpr double kLeastNormal = 2.2250738585072014e-308;
    constexpr std::uint64_t kMantissaBits = 0x000FFFFFFFFFFFFFull;
    constexpr std::uint64_t kHalf = 0x3FE0000000000000ull;
    constexpr std::uint64_t kTwoTo52 = 0x4330000000000000ull;

    // Split x into 2^exponent and a mantissa of root 1/2 to root 2
    const bool tiny = x < kLeastNormal;
    const std::uint64_t bits = bits_of(tiny ? x * kTwoTo54 : x);
    const double half_to_one = double_of((bits & kMantissaBits) | kHalf);
    const bool low = half_to_one < kRootHalf;
    const double mantissa = low ? half_to_one * 2.0 : half_to_one;
    const double biased = double_of(kTwoTo52 | bits >> 52) - 4503599627370496.0;
    const double exponent = biased - (tiny ? 1076.0 : 1022.0) - (low ? 1.0 : 0.0);

    // ln m = 2 atanh(s) with s = (m - 1) / (m + 1), |s| < 0.172: the series to s^23 is exact to float64
    const double s = (mantissa - 1.0) / (mantissa + 1.0);
    const double square = s * s;
    double series = 1.0 / 23.0;
    VOLSPLAT_UNROLL(16)
    for (int odd = 21; odd >= 3; odd -= 2) series = series * square + 1.0 / odd;
    const double logarithm = 2.0 * (s + s * square * series);
    return exponent + logarithm * kLog2E;
}

// 2^x for x up to 1000; 0 below the range of float64, relative error below 1e-15.
inline double exp2_exactly(double x) {
    constexpr double kLn2 = 0.69314718055994530942;
    constexpr double kLeast = -1022.0;
    constexpr double kToWhole = 6755399441055744.0;  // 1.5 * 2^52: adding it leaves no fraction

    // Split x into a whole number and a rest of -0.5..0.5
    const double within = x < kLeast ? kLeast : x;
    const double shifted = within + kToWhole;
    const double whole = shifted - kToWhole;
    const double y = (within - whole) * kLn2;
    const double power_of_two = double_of((bits_of(shifted) + 1023) << 52);

    // e^y by its series: the next term is y^16 / 16!, below 1e-20
    double factorial = 1307674368000.0;  // 15!
    double series = 1.0 / factorial;
    VOLSPLAT_UNROLL(16)
    for (int n = 15; n >= 1; --n) {
        factorial /= n;
        series = series * y + 1.0 / factorial;
    }
    return x < kLeast ? 0.0 : series * power_of_two;
}

// base^exponent for a base of 0 to 1 or what rounding may add, and an exponent of 0 to 1000, 0 excluded.
inline double power_of(double base, double exponent) {
    const double raised = exp2_exactly(exponent * log2_exactly(base > 0.0 ? base : 1.0));
    const double exact = base == 1.0 || exponent == 1.0 ? base : raised;
    return base > 0.0 ? exact : 0.0;
}

}  // namespace volsplat::VOLSPLAT_PATH
