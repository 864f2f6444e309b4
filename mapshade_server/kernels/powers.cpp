// Series for logarithm and exponential, long enough for float64.
#include "powers.h"

#include <bit>
#include <cstdint>

namespace volsplat {

namespace {

constexpr double kLn2 = 0.69314718055994530942;
constexpr double kRootHalf = 0.70710678118654752440;
constexpr std::uint64_t kMantissaBits = 0x000FFFFFFFFFFFFFull;
constexpr double kTwoTo54 = 18014398509481984.0;

}  // namespace

double log2_exactly(double x) {
  // Split x into 2^exponent and a mantissa around 1
  int exponent = 0;
  if (x < 2.2250738585072014e-308) {
    x *= kTwoTo54;
    exponent = -54;
  }
  const std::uint64_t bits = std::bit_cast<std::uint64_t>(x);
  exponent += static_cast<int>(bits >> 52) - 1022;
  double mantissa = std::bit_cast<double>((bits & kMantissaBits) | 0x3FE0000000000000ull);  // 0.5..1
  if (mantissa < kRootHalf) {
    mantissa *= 2.0;
    exponent -= 1;
  }

  // ln m = 2 atanh(s) with s = (m - 1) / (m + 1), |s| < 0.172: the series to s^23 is exact to float64
  const double s = (mantissa - 1.0) / (mantissa + 1.0);
  const double square = s * s;
  double series = 1.0 / 23.0;
  for (int odd = 21; odd >= 3; odd -= 2) series = series * square + 1.0 / odd;
  const double logarithm = 2.0 * (s + s * square * series);
  return exponent + logarithm / kLn2;
}

double exp2_exactly(double x) {
  if (x < -1022.0) return 0.0;
  // Split x into a whole number and a rest of -0.5..0.5
  const int whole = static_cast<int>(x < 0.0 ? x - 0.5 : x + 0.5);
  const double y = (x - whole) * kLn2;

  // e^y by its series: the next term is y^16 / 16!, below 1e-20
  double series = 1.0;
  for (int n = 15; n >= 1; --n) series = 1.0 + series * y / n;
  if (whole > 1023) return series * 0x1p1023 * 2.0;
  return series * std::bit_cast<double>(static_cast<std::uint64_t>(whole + 1023) << 52);
}

double power(double base, double exponent) {
  if (base <= 0.0) return 0.0;
  if (base == 1.0 || exponent == 1.0) return base;
  return exp2_exactly(exponent * log2_exactly(base));
}

}  // namespace volsplat
