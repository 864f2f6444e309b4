// Finds the voxels that can be seen, by two bits each: one for its density, one for its strength. Most voxels of a
// volume end here.
#include "kept_lanes.h"
#include "map_shade_kernels.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

#if defined(__AVX512F__)

// Answers for 16 packets at once; the bits lie in registers.
class Seen {
 public:
  explicit Seen(const Visibility& visibility)
      : density_(_mm512_broadcast_i64x4(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(visibility.density)))),
        strength_(_mm512_broadcast_i64x4(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(visibility.strength)))) {}

  std::uint32_t operator()(const std::uint32_t* packets) const { return of(_mm512_loadu_si512(packets)); }

  __mmask16 of(__m512i packet) const {
    // A word of 32 bits is picked by the byte's upper bits, and turned until the wanted bit is lowest
    const __m512i density_word = _mm512_permutexvar_epi32(_mm512_srli_epi32(packet, 5), density_);
    const __m512i strength_word = _mm512_permutexvar_epi32(_mm512_srli_epi32(packet, 13), strength_);
    const __m512i both = _mm512_and_si512(_mm512_rorv_epi32(density_word, packet),
                                          _mm512_rorv_epi32(strength_word, _mm512_srli_epi32(packet, 8)));
    const __mmask16 seen = _mm512_test_epi32_mask(both, _mm512_set1_epi32(1));
    return _kandn_mask16(_mm512_movepi32_mask(packet), seen);
  }

 private:
  __m512i density_, strength_;
};

#elif defined(__AVX2__)

// Answers for 8 packets at once; the bits lie in registers.
class Seen {
 public:
  explicit Seen(const Visibility& visibility)
      : density_(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(visibility.density))),
        strength_(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(visibility.strength))) {}

  std::uint32_t operator()(const std::uint32_t* packets) const {
    return of(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(packets)));
  }

  std::uint32_t of(__m256i packet) const {
    // A word of 32 bits is picked by the byte's upper bits, and shifted until the wanted bit is the sign
    const __m256i strength = _mm256_srli_epi32(packet, 8);
    const __m256i density_word = _mm256_permutevar8x32_epi32(density_, _mm256_srli_epi32(packet, 5));
    const __m256i strength_word = _mm256_permutevar8x32_epi32(strength_, _mm256_srli_epi32(packet, 13));
    const __m256i to_sign = _mm256_set1_epi32(31);
    const __m256i both = _mm256_and_si256(_mm256_sllv_epi32(density_word, _mm256_andnot_si256(packet, to_sign)),
                                          _mm256_sllv_epi32(strength_word, _mm256_andnot_si256(strength, to_sign)));
    return static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(_mm256_andnot_si256(packet, both))));
  }

 private:
  __m256i density_, strength_;
};

#else

// Answers for 4 packets at once.
class Seen {
 public:
  explicit Seen(const Visibility& visibility) : visibility_(visibility) {}

  std::uint32_t operator()(const std::uint32_t* packets) const {
    std::uint32_t seen = 0;
    for (int lane = 0; lane < kLanes; ++lane) seen |= of(packets[lane]) << lane;
    return seen;
  }

  std::uint32_t of(std::uint32_t packet) const {
    const std::uint32_t density = visibility_.density[packet >> 5 & 7] >> (packet & 31);
    const std::uint32_t strength = visibility_.strength[packet >> 13 & 7] >> (packet >> 8 & 31);
    return density & strength & ~(packet >> 31) & 1;
  }

 private:
  const Visibility& visibility_;
};

#endif

// The answers for `lanes` packets as one number.
template <int lanes>
std::uint64_t seen_of(const Seen& seen, const std::uint32_t* packets) {
  std::uint64_t all = 0;
  for (int lane = 0; lane < lanes; lane += kLanes) {
    all |= static_cast<std::uint64_t>(seen(packets + lane)) << lane;
  }
  return all;
}

}  // namespace

std::size_t classify_row(const std::uint32_t* row, std::size_t n, std::size_t first, const Visibility& visibility,
                         std::uint16_t* positions, std::uint32_t* packets) {
  constexpr int kTogether = 32;  // few stretches of so many voxels change between empty and not
  const Seen seen(visibility);
  std::size_t kept = 0;
  for (std::size_t at = 0; at < n; at += kTogether) {
    std::uint64_t bits = seen_of<kTogether>(seen, row + at);
    if (n - at < kTogether) bits &= (std::uint64_t{1} << (n - at)) - 1;
    if (bits == 0) continue;
    for (int lane = 0; lane < kTogether; lane += kLanes) {
      const std::uint32_t here = static_cast<std::uint32_t>(bits >> lane) & ((1u << kLanes) - 1);
      const std::size_t from = at + static_cast<std::size_t>(lane);
      kept += keep(positions_from(first + from), row + from, here, positions + kept, packets + kept);
    }
  }
  return kept;
}

void classify_columns(const std::uint32_t* source, std::ptrdiff_t stride, std::size_t n, std::uint64_t wanted,
                      const Visibility& visibility, const VoxelLanes& lanes, std::uint32_t* counts) {
  // So far ahead that the line has arrived from memory when it is needed, but not so far that lines a power of two
  // apart push each other out of the cache
  constexpr std::ptrdiff_t kLinesAhead = 8;
  constexpr std::ptrdiff_t kPacketsPerCacheLine = 16;
  const Seen seen(visibility);
  for (int lane = 0; lane < kStripLanes; ++lane) counts[lane] = 0;
  for (std::size_t at = 0; at < n; ++at) {
    const std::uint32_t* line = source + static_cast<std::ptrdiff_t>(at) * stride;
    for (int lane = 0; lane < kStripLanes; lane += kPacketsPerCacheLine) {
      __builtin_prefetch(line + kLinesAhead * stride + lane);
    }
    for (std::uint64_t bits = seen_of<kStripLanes>(seen, line) & wanted; bits != 0; bits &= bits - 1) {
      const int lane = __builtin_ctzll(bits);
      const std::size_t to = static_cast<std::size_t>(lane) * lanes.pitch + counts[lane]++;
      lanes.positions[to] = static_cast<std::uint16_t>(at);
      lanes.packets[to] = line[lane];
    }
  }
}

}  // namespace volsplat::VOLSPLAT_PATH
