// Scalar types and memory that arrays share with Python.
#include "arrays.h"

#include "kernels/large_memory.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"

namespace volsplat {

namespace {

Scalar scalar_of(nb::dlpack::dtype type) {
    if (type == nb::dtype<std::uint8_t>()) return Scalar::u8;
    if (type == nb::dtype<std::int8_t>()) return Scalar::i8;
    if (type == nb::dtype<std::uint16_t>()) return Scalar::u16;
    if (type == nb::dtype<std::int16_t>()) return Scalar::i16;
    if (type == nb::dtype<std::uint32_t>()) return Scalar::u32;
    if (type == nb::dtype<std::int32_t>()) return Scalar::i32;
    if (type == nb::dtype<std::uint64_t>()) return Scalar::u64;
    if (type == nb::dtype<std::int64_t>()) return Scalar::i64;
    if (type == nb::dtype<float>()) return Scalar::f32;
    if (type == nb::dtype<double>()) return Scalar::f64;
    throw nb::type_error("a volume's values must be integers of 8 to 64 bits or floats of 32 or 64 bits");
}

}  // namespace

SourceVolume source_of(const SourceArray& array) {
    SourceVolume source{array.data(), scalar_of(array.dtype()), {}, {}};
    for (int axis = 0; axis < 3; ++axis) {
        source.size[axis] = static_cast<std::int64_t>(array.shape(2 - axis));
        source.strides[axis] = array.stride(2 - axis);
    }
    return source;
}

PacketMemory packet_memory(const Index3& size) {
    const std::size_t packets = static_cast<std::size_t>(size[0] * size[1] * size[2]) + kSpare;
    std::uint32_t* memory = large_array<std::uint32_t>(packets).release();
    const nb::capsule owner(memory, [](void* p) noexcept { FreeMemory()(p); });
    const auto extent = [&](int axis) { return static_cast<std::size_t>(size[axis]); };
    return {memory,
            nb::cast(nb::ndarray<nb::array_api, std::uint32_t>(memory, {extent(2), extent(1), extent(0)}, owner))};
}

}  // namespace volsplat
