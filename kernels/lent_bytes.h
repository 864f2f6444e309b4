// Memory that Python lends to a kernel as plain bytes, by the buffer protocol, without copies.
#pragma once

#include <nanobind/ndarray.h>

#include <cstdint>

namespace volsplat {

using LentBytes = nanobind::ndarray<nanobind::ro, nanobind::c_contig, nanobind::device::cpu>;  // to be read
using LentRoom =
    nanobind::ndarray<std::uint8_t, nanobind::ndim<1>, nanobind::c_contig, nanobind::device::cpu>;  // filled

inline const std::uint8_t* bytes_of(const LentBytes& lent) { return static_cast<const std::uint8_t*>(lent.data()); }

}  // namespace volsplat
