// Reads rows of any scalar type as float64.
#include "source_volume.h"

#include <cmath>
#include <limits>
#include <type_traits>

namespace volsplat {

namespace {

template <typename T>
void convert(const void* data, std::int64_t offset, std::int64_t stride, std::int64_t n, double* out) {
    const T* from = static_cast<const T*>(data) + offset;
    for (std::int64_t at = 0; at < n; ++at) {
        const double value = static_cast<double>(from[at * stride]);
        if constexpr (std::is_floating_point_v<T>) {
            out[at] = std::isfinite(value) ? value : std::numeric_limits<double>::quiet_NaN();
        } else {
            out[at] = value;
        }
    }
}

}  // namespace

void SourceVolume::read_row(std::int64_t k, std::int64_t j, std::int64_t i, std::int64_t n, double* out) const {
    const std::int64_t offset = i * strides[0] + j * strides[1] + k * strides[2];
    switch (scalar) {
        case Scalar::u8:
            return convert<std::uint8_t>(data, offset, strides[0], n, out);
        case Scalar::i8:
            return convert<std::int8_t>(data, offset, strides[0], n, out);
        case Scalar::u16:
            return convert<std::uint16_t>(data, offset, strides[0], n, out);
        case Scalar::i16:
            return convert<std::int16_t>(data, offset, strides[0], n, out);
        case Scalar::u32:
            return convert<std::uint32_t>(data, offset, strides[0], n, out);
        case Scalar::i32:
            return convert<std::int32_t>(data, offset, strides[0], n, out);
        case Scalar::u64:
            return convert<std::uint64_t>(data, offset, strides[0], n, out);
        case Scalar::i64:
            return convert<std::int64_t>(data, offset, strides[0], n, out);
        case Scalar::f32:
            return convert<float>(data, offset, strides[0], n, out);
        case Scalar::f64:
            return convert<double>(data, offset, strides[0], n, out);
    }
}

}  // namespace volsplat
