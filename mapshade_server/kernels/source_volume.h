// The values of a box of the volume as a reader handed them over: any scalar type, any strides.
#pragma once

#include <array>
#include <cstdint>

namespace volsplat {

using Index3 = std::array<std::int64_t, 3>;  // grid i, j, k

enum class Scalar { u8, i8, u16, i16, u32, i32, u64, i64, f32, f64 };

struct SourceVolume {
    const void* data;
    Scalar scalar;
    Index3 size;
    Index3 strides;  // in elements

    // float64 values of the row (k, j) from column i on; values that are not finite become NaN, no data.
    void read_row(std::int64_t k, std::int64_t j, std::int64_t i, std::int64_t n, double* out) const;
};

}  // namespace volsplat
