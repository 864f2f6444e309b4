// Powers of float32, for what pixels show: relative errors of some 1e-7 times the exponent. Written without branches,
// so that the compiler makes vectors of loops over them.
#pragma once

#include <cstdint>

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr float kLeastExponent = -125.0f;

inline std::int32_t bits_of(float x) { return __builtin_bit_cast(std::int32_t, x); }
inline float float_of(std::int32_t bits) { return __builtin_bit_cast(float, bits); }

// e^y - 1 for y up to half of ln 2, 2^n and the n of 2^x = 2^n e^y.
struct PowerOfTwo {
    float rest, whole;
};

inline PowerOfTwo power_of_two(float x) {
    constexpr float kToWhole = 12582912.0f;  // 1.5 * 2^23: adding it leaves no fraction
    constexpr float kLn2 = 0.69314718f;
    const float within = x < kLeastExponent ? kLeastExponent : x;
    const float shifted = within + kToWhole;
    const float y = (within - (shifted - kToWhole)) * kLn2;
    float series = 1.0f / 5040;
    series = series * y + 1.0f / 720;
    series = series * y + 1.0f / 120;
    series = series * y + 1.0f / 24;
    series = series * y + 1.0f / 6;
    series = series * y + 0.5f;
    series = series * y + 1.0f;
    return {series * y, float_of((bits_of(shifted) + 127) << 23)};
}

// 1 - e^-depth, also where little is stopped.
inline float stopped_by(float depth) {
    constexpr float kLog2E = 1.44269504f;
    const PowerOfTwo power = power_of_two(-depth * kLog2E);
    return (1.0f - power.whole) - power.whole * power.rest;
}

// base^exponent for a base of 0 to 1 or what rounding may add, and an exponent of 0 to 1000, 0 excluded.
inline float highlight(float base, float exponent) {
    constexpr float kRootHalf = 0.70710678f, kLog2E = 1.44269504f;
    const float positive = base > 1e-30f ? base : 1e-30f;
    // Split into 2^whole and a mantissa of root 1/2 to root 2
    const std::int32_t bits = bits_of(positive);
    const float half_to_one = float_of((bits & 0x007FFFFF) | 0x3F000000);
    const bool low = half_to_one < kRootHalf;
    const float mantissa = low ? half_to_one * 2.0f : half_to_one;
    const float whole = static_cast<float>((bits >> 23) - 126) - (low ? 1.0f : 0.0f);
    // ln m = 2 atanh(s) with s = (m - 1) / (m + 1), |s| < 0.172
    const float s = (mantissa - 1.0f) / (mantissa + 1.0f), square = s * s;
    float series = 1.0f / 9;
    series = series * square + 1.0f / 7;
    series = series * square + 1.0f / 5;
    series = series * square + 1.0f / 3;
    const float logarithm = whole + 2.0f * (s + s * square * series) * kLog2E;
    const PowerOfTwo power = power_of_two(exponent * logarithm);
    return base > 0.0f ? power.whole + power.whole * power.rest : 0.0f;
}

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
