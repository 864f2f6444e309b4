// The floors of `volsplat bench kernels`: the kernels' work with everything else taken away, for each CPU path.
#pragma once
#include <cstddef>
#include <cstdint>

namespace volsplat {

// Tables of the map/shade floor; colours are r, g, b and one unused, in levels of 8 bits.
struct BareTables {
  const std::uint16_t* opacity;  // 65536 codes, by the lower 16 bits of a voxel packet
  const float* emit;             // 256 x 4, by density
  const float* refl;             // 256 x 4, by density
  const float* light;            // 32768, by direction code
};

#define VOLSPLAT_DECLARE_BARE_LOOPS(path)                                                                            \
  namespace path {                                                                                                   \
  void bare_splat(float* image, std::int64_t pitch, const std::int32_t* corners, std::int64_t count, int side,       \
                  const float* weights, const float* sample);                                                        \
  std::int64_t bare_shade(const std::uint32_t* packets, std::int64_t count, const BareTables& tables,                \
                          std::uint64_t* shaded);                                                                    \
  }
VOLSPLAT_DECLARE_BARE_LOOPS(baseline)
VOLSPLAT_DECLARE_BARE_LOOPS(avx2)
VOLSPLAT_DECLARE_BARE_LOOPS(avx512)
#undef VOLSPLAT_DECLARE_BARE_LOOPS

}  // namespace volsplat
