// Leaves out samples that lie where the image is closed, one bit looked up for each.
#include "kept_lanes.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

constexpr float kPixel = 4294967296.0f;  // 2^-32 pixel

typedef std::int32_t Integers __attribute__((vector_size(4 * kLanes)));
typedef std::uint32_t Words __attribute__((vector_size(4 * kLanes)));
typedef float Reals __attribute__((vector_size(4 * kLanes)));

#if defined(__AVX512F__)

Words words_at(const std::uint32_t* words, Integers places) {
  return (Words)_mm512_i32gather_epi32((__m512i)places, words, 4);
}

// A bit for each lane.
std::uint32_t lanes_of(Words ones) { return _mm512_test_epi32_mask((__m512i)ones, (__m512i)ones); }

#elif defined(__AVX2__)

Words words_at(const std::uint32_t* words, Integers places) {
  return (Words)_mm256_i32gather_epi32(reinterpret_cast<const int*>(words), (__m256i)places, 4);
}

std::uint32_t lanes_of(Words ones) { return static_cast<unsigned>(_mm256_movemask_ps((__m256)(ones << 31))); }

#else

Words words_at(const std::uint32_t* words, Integers places) {
  return Words{words[places[0]], words[places[1]], words[places[2]], words[places[3]]};
}

std::uint32_t lanes_of(Words ones) { return ones[0] | ones[1] << 1 | ones[2] << 2 | ones[3] << 3; }

#endif

// Pixels along one axis in which samples of a line lie, moved into the image. All instruction sets round alike; see
// ClosedTiles for how much.
struct LinePixels {
  float start, step;
  std::int32_t last;

  LinePixels(std::int64_t line_start, std::int64_t line_step, std::int32_t last_pixel)
      : start(static_cast<float>(line_start) / kPixel),
        step(static_cast<float>(line_step) / kPixel),
        last(last_pixel) {}

  Integers at(Integers n) const {
    const Integers pixels = __builtin_convertvector(start + __builtin_convertvector(n, Reals) * step, Integers);
    const Integers not_beyond = pixels < last ? pixels : Integers{} + last;
    return not_beyond > 0 ? not_beyond : Integers{};
  }
};

// A bit for each lane: not hidden.
std::uint32_t open_lanes(const HiddenMap& map, const LinePixels& x, const LinePixels& y, Integers n) {
  const Integers column = x.at(n), word = y.at(n) * map.words_in_row + (column >> 5);
  return lanes_of(~words_at(map.words, word) >> (Words)(column & 31) & 1);
}

}  // namespace

std::size_t leave_out_hidden(const VisibleVoxels& voxels, const HiddenMap& map, const RowLine& line,
                             std::uint16_t* positions, std::uint32_t* packets) {
  if (voxels.count == 0) return 0;
  // Counted from the first voxel, which lies near the image, float32 is enough
  const std::int32_t first = voxels.positions[0];
  const LinePixels x(line.start_x + first * line.step_x, line.step_x, map.last_column);
  const LinePixels y(line.start_y + first * line.step_y, line.step_y, map.last_row);
  std::size_t kept = 0;
  for (std::size_t at = 0; at < voxels.count; at += kLanes) {
    const Positions lanes = positions_at(voxels.positions + at);
    std::uint32_t open = open_lanes(map, x, y, (Integers)lanes - first);
    if (voxels.count - at < kLanes) open &= (1u << (voxels.count - at)) - 1;
    if (open == 0) continue;  // and do not wait for its packets
    kept += keep(lanes, voxels.packets + at, open, positions + kept, packets + kept);
  }
  return kept;
}

}  // namespace volsplat::VOLSPLAT_PATH
