// How arrays pass between Python and the kernels: DLPack or the buffer protocol, without copies.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <memory>
#include <utility>
#include <vector>

#include "mapshade_server/kernels/source_volume.h"

namespace volsplat {

namespace nb = nanobind;

using SourceArray = nb::ndarray<nb::ro, nb::ndim<3>, nb::device::cpu>;  // (k, j, i), any scalar type

// Throws nb::type_error for scalar types that no volume has.
SourceVolume source_of(const SourceArray& array);

// A Python array that owns `values`.
template <typename T, typename... Sizes>
nb::object owned_array(std::vector<T>&& values, Sizes... sizes) {
    auto* held = new std::vector<T>(std::move(values));
    nb::capsule owner(held, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return nb::cast(nb::ndarray<nb::array_api, T>(held->data(), {static_cast<std::size_t>(sizes)...}, owner));
}

// Room for the voxel packets of a box and kSpare more, uninitialised: a Python array (k, j, i) that owns it.
struct PacketMemory {
    std::uint32_t* packets;
    nb::object array;
};
PacketMemory packet_memory(const Index3& size);

}  // namespace volsplat
