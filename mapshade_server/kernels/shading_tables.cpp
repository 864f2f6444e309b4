// Fills the tables; see the header for what each of them holds.
#include "shading_tables.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "powers.h"

namespace volsplat {

namespace {

constexpr int kSide = 181;  // of the octahedral code
constexpr int kMiddle = 90;
constexpr double kOpacityUnit = 511.0 * 16384.0;
constexpr int kOpacityCodes = 4096;

int sign(int x) { return x < 0 ? -1 : 1; }

// The direction of a code as whole numbers, not normalised.
std::array<int, 3> whole_direction(int code, bool octahedral) {
  if (!octahedral) return {(code & 31) - 16, (code >> 5 & 31) - 16, (code >> 10 & 31) - 16};
  if (code >= kSide * kSide) return {0, 0, 0};
  const int x = code % kSide - kMiddle, y = code / kSide - kMiddle;
  const int z = kMiddle - std::abs(x) - std::abs(y);
  if (z >= 0) return {x, y, z};
  return {(kMiddle - std::abs(y)) * sign(x), (kMiddle - std::abs(x)) * sign(y), z};
}

double dot(const double* a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

}  // namespace

std::vector<double> direction_vectors(bool octahedral) {
  std::vector<double> vectors(3 * kDirectionCodes, 0.0);
  for (int code = 0; code < kDirectionCodes; ++code) {
    const auto [x, y, z] = whole_direction(code, octahedral);
    if (x == 0 && y == 0 && z == 0) continue;
    const double length = std::sqrt(static_cast<double>(x * x + y * y + z * z));
    vectors[3 * code] = x / length;
    vectors[3 * code + 1] = y / length;
    vectors[3 * code + 2] = z / length;
  }
  return vectors;
}

std::vector<std::uint8_t> gradient_bytes(bool octahedral, const std::array<Vector3, 3>& axes) {
  const std::vector<double> vectors = direction_vectors(octahedral);
  std::vector<std::uint8_t> bytes(3 * kDirectionCodes);
  for (int axis = 0; axis < 3; ++axis) {
    for (int code = 0; code < kDirectionCodes; ++code) {
      const double along = dot(&vectors[3 * code], axes[axis]);
      bytes[axis * kDirectionCodes + code] = static_cast<std::uint8_t>(std::clamp(128.5 + 127.0 * along, 0.0, 255.0));
    }
  }
  return bytes;
}

std::vector<float> light_table(bool octahedral, const Lighting& lighting) {
  const std::vector<double> gradients = direction_vectors(octahedral);
  std::vector<float> table(kDirectionCodes, 0.0f);
  for (int code = 0; code < kDirectionCodes; ++code) {
    // The outward normal G is the opposite of the gradient; no direction, no light
    const double* gradient = &gradients[3 * code];
    if (gradient[0] == 0.0 && gradient[1] == 0.0 && gradient[2] == 0.0) continue;
    double towards_light = -dot(gradient, lighting.light), towards_half = -dot(gradient, lighting.half);
    if (lighting.two_sided) {
      towards_light = std::fabs(towards_light);
      towards_half = std::fabs(towards_half);
    }
    if (!(towards_light > 0.0)) continue;
    double light = lighting.diffuse ? towards_light : 0.0;
    if (lighting.specular) light += power(std::max(0.0, towards_half), lighting.specular_power);
    table[code] = static_cast<float>(light);
  }
  return table;
}

std::vector<std::uint16_t> opacity_table(const double* opac, const double* modu, double exponent) {
  std::vector<std::uint16_t> codes(kTableEntries * kTableEntries);
  for (int m = 0; m < kTableEntries; ++m) {
    std::uint16_t* row = &codes[m * kTableEntries];
    // Tables are often constant over long stretches, and powers are slow
    if (m > 0 && modu[m] == modu[m - 1]) {
      std::copy(row - kTableEntries, row, row);
      continue;
    }
    for (int o = 0; o < kTableEntries; ++o) {
      if (o > 0 && opac[o] == opac[o - 1]) {
        row[o] = row[o - 1];
        continue;
      }
      const double thin = opac[o] * modu[m];
      row[o] = code_of_opacity(exponent == 1.0 ? thin : 1.0 - power(1.0 - thin, exponent));
    }
  }
  return codes;
}

std::uint16_t code_of_opacity(double opacity) {
  const double units = std::clamp(opacity, 0.0, 1.0) * (kOpacityUnit * 256.0) + 0.5;
  const std::uint64_t fine = static_cast<std::uint64_t>(units);  // in 1/256 of the smallest step
  const int exponent = std::max(static_cast<int>(std::bit_width(fine)) - 16, 0);
  if (exponent <= 1) return static_cast<std::uint16_t>((fine + 128) >> 8);
  const int shift = exponent + 7;
  const int code = (exponent << 8) + static_cast<int>((fine + (std::uint64_t{1} << (shift - 1))) >> shift) - 256;
  return static_cast<std::uint16_t>(std::min(code, kOpacityCodes - 1));
}

}  // namespace volsplat
