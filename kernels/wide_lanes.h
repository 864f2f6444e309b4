// What a loop does with the widest vectors, lane by lane: looking up, counting bits, and moving lanes about. Written
// once for each instruction set, and once more in plain C++ for all others.
#pragma once

#include <cstddef>

#include "kernels/vectors.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

typedef Widest Reals;
typedef WidestBits Integers;
typedef WidestWords Words;

// Lane numbers counted from `first`.
inline Integers counted_from(std::int32_t first) {
    std::int32_t counts[kWidest];
    for (int lane = 0; lane < kWidest; ++lane) counts[lane] = lane;
    return load<Integers>(counts) + first;
}

// A bit for each of the first `count` lanes, or for all.
inline std::uint32_t lanes_before(std::size_t count) { return count < kWidest ? (1u << count) - 1 : ~std::uint32_t{0}; }

// Writes the first `count` lanes, or all.
inline void store_first(float* numbers, const Reals& lanes, std::size_t count) {
    if (count >= kWidest) {
        store(numbers, lanes);
    } else {
        __builtin_memcpy(numbers, &lanes, count * sizeof(float));
    }
}

#if defined(__AVX512F__)

// A bit for each lane: its highest one.
inline std::uint32_t signs(Words lanes) { return _mm512_movepi32_mask((__m512i)lanes); }

// Numbers of 16 bits, as many as there are lanes.
inline Integers widened(const std::uint16_t* numbers) {
    return (Integers)_mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(numbers)));
}
inline void store_narrowed(std::uint16_t* numbers, Words lanes) {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(numbers), _mm512_cvtepi32_epi16((__m512i)lanes));
}

// A table's entries at places 0 and up. Of a table of 16 bits the lower half, and one more entry is read.
inline Words looked_up(const std::uint32_t* table, Words places) {
    return (Words)_mm512_i32gather_epi32((__m512i)places, table, 4);
}
inline Reals looked_up(const float* table, Words places) { return _mm512_i32gather_ps((__m512i)places, table, 4); }
inline Words looked_up(const std::uint16_t* table, Words places) {
    return (Words)_mm512_i32gather_epi32((__m512i)places, table, 2) & 0xFFFF;
}

// Of words in memory, a bit for each: the highest one of what is computed of it. There `bit_as_sign` moves that bit of
// a word to the highest place which the lowest five bits of `places` number.
template <class Compute>
inline std::uint32_t signs_of(const std::uint32_t* words, const Compute& compute) {
    return signs(compute(load<Words>(words)));
}
inline Words bit_as_sign(Words words, Words places) { return words << (31 & ~places); }

// A table of eight words, looked up by the lowest three bits of each place.
class EightWords {
public:
    explicit EightWords(const std::uint32_t (&words)[8])
        : words_(_mm512_broadcast_i64x4(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(words)))) {}

    Words operator[](Words places) const { return (Words)_mm512_permutexvar_epi32((__m512i)places, words_); }

private:
    __m512i words_;
};

// Writes the lanes whose bit is set next to each other, and anything behind them, as many as there are lanes.
inline void store_chosen(std::uint32_t* words, std::uint32_t bits, const std::uint32_t* lanes) {
    const __m512i all = _mm512_loadu_si512(lanes);
    _mm512_storeu_si512(words, _mm512_maskz_compress_epi32(static_cast<__mmask16>(bits), all));
}
inline void store_chosen(std::uint16_t* numbers, std::uint32_t bits, Words lanes) {
    store_narrowed(numbers, (Words)_mm512_maskz_compress_epi32(static_cast<__mmask16>(bits), (__m512i)lanes));
}

// The whole part of start + n * step, computed in float64.
inline Words whole_part(double start, double step, Integers n) {
    const auto half = [&](__m256i counts) {
        const __m512d way = _mm512_mul_pd(_mm512_cvtepi32_pd(counts), _mm512_set1_pd(step));
        return _mm512_cvttpd_epi32(_mm512_add_pd(_mm512_set1_pd(start), way));
    };
    return (Words)_mm512_inserti64x4(_mm512_castsi256_si512(half(_mm512_castsi512_si256((__m512i)n))),
                                     half(_mm512_extracti64x4_epi64((__m512i)n, 1)), 1);
}

inline Reals at_least_0(Reals a) { return _mm512_maskz_max_ps(0xFFFF, a, _mm512_setzero_ps()); }
inline Reals square_root(Reals a) { return _mm512_maskz_sqrt_ps(0xFFFF, a); }

// Blocks of four lanes: four numbers from the address of each block.
template <class AddressOf>
inline Reals blocks(const AddressOf& address_of) {
    const __m512 first = _mm512_castps128_ps512(_mm_loadu_ps(address_of(0)));
    const __m512 half = _mm512_insertf32x4(first, _mm_loadu_ps(address_of(1)), 1);
    return _mm512_insertf32x4(_mm512_insertf32x4(half, _mm_loadu_ps(address_of(2)), 2), _mm_loadu_ps(address_of(3)), 3);
}

// In each block lane q of it, four times.
template <int q>
inline Reals lane_of_blocks(Reals lanes) {
    return _mm512_permute_ps(lanes, q * 0x55);
}

// In each block the bytes of four blocks, each in a lane; they hold 0 to 255.
inline Words bytes_of_blocks(Integers a, Integers b, Integers c, Integers d) {
    return (Words)_mm512_packus_epi16(_mm512_packs_epi32((__m512i)a, (__m512i)b),
                                      _mm512_packs_epi32((__m512i)c, (__m512i)d));
}

// Writes numbers of 64 bits made of lower and upper halves, the first or the last one first.
inline void store_pairs(std::uint64_t* numbers, Words low, Words high, bool descending) {
    static constexpr std::uint32_t kOrders[2][2][16] = {
        {{0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23},
         {8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31}},
        {{15, 31, 14, 30, 13, 29, 12, 28, 11, 27, 10, 26, 9, 25, 8, 24},
         {7, 23, 6, 22, 5, 21, 4, 20, 3, 19, 2, 18, 1, 17, 0, 16}}};
    for (int half = 0; half < 2; ++half) {
        const __m512i order = _mm512_loadu_si512(kOrders[descending][half]);
        _mm512_storeu_si512(numbers + 8 * half, _mm512_permutex2var_epi32((__m512i)low, order, (__m512i)high));
    }
}

#elif defined(__AVX2__)

inline std::uint32_t signs(Words lanes) { return static_cast<unsigned>(_mm256_movemask_ps((__m256)lanes)); }

inline Integers widened(const std::uint16_t* numbers) {
    return (Integers)_mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(numbers)));
}
inline void store_narrowed(std::uint16_t* numbers, Words lanes) {
    const __m128i low = _mm256_castsi256_si128((__m256i)lanes), high = _mm256_extracti128_si256((__m256i)lanes, 1);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(numbers), _mm_packus_epi32(low, high));
}

inline Words looked_up(const std::uint32_t* table, Words places) {
    return (Words)_mm256_i32gather_epi32(reinterpret_cast<const int*>(table), (__m256i)places, 4);
}
inline Reals looked_up(const float* table, Words places) { return _mm256_i32gather_ps(table, (__m256i)places, 4); }
inline Words looked_up(const std::uint16_t* table, Words places) {
    return (Words)_mm256_i32gather_epi32(reinterpret_cast<const int*>(table), (__m256i)places, 2) & 0xFFFF;
}

template <class Compute>
inline std::uint32_t signs_of(const std::uint32_t* words, const Compute& compute) {
    return signs(compute(load<Words>(words)));
}
inline Words bit_as_sign(Words words, Words places) { return words << (31 & ~places); }

class EightWords {
public:
    explicit EightWords(const std::uint32_t (&words)[8]) : words_(load<Words>(words)) {}

    Words operator[](Words places) const { return (Words)picked((Reals)words_, (Integers)places); }

private:
    Words words_;
};

// For each mask of 8 lanes: the lane numbers whose bits are set, moved to the front.
struct LaneOrders {
    std::uint32_t of_mask[256][8];
    constexpr LaneOrders() : of_mask{} {
        for (int mask = 0; mask < 256; ++mask) {
            int filled = 0;
            for (int lane = 0; lane < 8; ++lane) {
                if (mask >> lane & 1) of_mask[mask][filled++] = static_cast<std::uint32_t>(lane);
            }
        }
    }
};
constexpr LaneOrders kLaneOrders;

inline Words chosen_first(std::uint32_t bits, Words lanes) {
    return (Words)picked((Reals)lanes, load<Integers>(kLaneOrders.of_mask[bits]));
}
inline void store_chosen(std::uint32_t* words, std::uint32_t bits, const std::uint32_t* lanes) {
    store(words, chosen_first(bits, load<Words>(lanes)));
}
inline void store_chosen(std::uint16_t* numbers, std::uint32_t bits, Words lanes) {
    store_narrowed(numbers, chosen_first(bits, lanes));
}

inline Words whole_part(double start, double step, Integers n) {
    const auto half = [&](__m128i counts) {
        const __m256d way = _mm256_mul_pd(_mm256_cvtepi32_pd(counts), _mm256_set1_pd(step));
        return _mm256_cvttpd_epi32(_mm256_add_pd(_mm256_set1_pd(start), way));
    };
    return (Words)_mm256_inserti128_si256(_mm256_castsi128_si256(half(_mm256_castsi256_si128((__m256i)n))),
                                          half(_mm256_extracti128_si256((__m256i)n, 1)), 1);
}

inline Reals at_least_0(Reals a) { return _mm256_max_ps(a, _mm256_setzero_ps()); }
inline Reals square_root(Reals a) { return _mm256_sqrt_ps(a); }

template <class AddressOf>
inline Reals blocks(const AddressOf& address_of) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(address_of(0))), _mm_loadu_ps(address_of(1)), 1);
}

template <int q>
inline Reals lane_of_blocks(Reals lanes) {
    return _mm256_permute_ps(lanes, q * 0x55);
}

inline Words bytes_of_blocks(Integers a, Integers b, Integers c, Integers d) {
    return (Words)_mm256_packus_epi16(_mm256_packs_epi32((__m256i)a, (__m256i)b),
                                      _mm256_packs_epi32((__m256i)c, (__m256i)d));
}

inline void store_pairs(std::uint64_t* numbers, Words low, Words high, bool descending) {
    if (descending) {
        const Integers reversed = {7, 6, 5, 4, 3, 2, 1, 0};
        low = (Words)picked((Reals)low, reversed), high = (Words)picked((Reals)high, reversed);
    }
    const __m256i inner = _mm256_unpacklo_epi32((__m256i)low, (__m256i)high);
    const __m256i outer = _mm256_unpackhi_epi32((__m256i)low, (__m256i)high);
    store(numbers, _mm256_permute2x128_si256(inner, outer, 0x20));
    store(numbers + 4, _mm256_permute2x128_si256(inner, outer, 0x31));
}

#else

inline std::uint32_t signs(Words lanes) {
#if defined(__SSE2__)
    return static_cast<unsigned>(_mm_movemask_ps((Four)lanes));
#else
    return lanes[0] >> 31 | lanes[1] >> 31 << 1 | lanes[2] >> 31 << 2 | lanes[3] >> 31 << 3;
#endif
}

inline Integers widened(const std::uint16_t* numbers) {
    return Integers{numbers[0], numbers[1], numbers[2], numbers[3]};
}
inline void store_narrowed(std::uint16_t* numbers, Words lanes) {
    for (int lane = 0; lane < kWidest; ++lane) numbers[lane] = static_cast<std::uint16_t>(lanes[lane]);
}

template <class Number>
inline Words looked_up(const Number* table, Words places) {
    return Words{table[places[0]], table[places[1]], table[places[2]], table[places[3]]};
}
inline Reals looked_up(const float* table, Words places) {
    return Reals{table[places[0]], table[places[1]], table[places[2]], table[places[3]]};
}

// One by one: these sets shift all lanes by the same only.
template <class Compute>
inline std::uint32_t signs_of(const std::uint32_t* words, const Compute& compute) {
    std::uint32_t bits = 0;
    for (int lane = 0; lane < kWidest; ++lane) bits |= compute(words[lane]) >> 31 << lane;
    return bits;
}
inline std::uint32_t bit_as_sign(std::uint32_t word, std::uint32_t place) { return word >> (place & 31) << 31; }

class EightWords {
public:
    explicit EightWords(const std::uint32_t (&words)[8]) : words_(words) {}

    std::uint32_t operator[](std::uint32_t place) const { return words_[place & 7]; }

private:
    const std::uint32_t* words_;
};

template <class Number, class Lanes>
inline void store_chosen(Number* numbers, std::uint32_t bits, const Lanes& lanes) {
    for (int lane = 0; lane < kWidest; ++lane) {
        *numbers = static_cast<Number>(lanes[lane]);
        numbers += bits >> lane & 1;
    }
}

inline Words whole_part(double start, double step, Integers n) {
    Words whole;
    for (int lane = 0; lane < kWidest; ++lane) {
        whole[lane] = static_cast<std::uint32_t>(static_cast<std::int32_t>(start + n[lane] * step));
    }
    return whole;
}

inline Reals at_least_0(Reals a) { return (Reals)((Integers)a & (a > 0.0f)); }
inline Reals square_root(Reals a) {
#if defined(__SSE2__)
    return _mm_sqrt_ps(a);
#else
    return Reals{__builtin_sqrtf(a[0]), __builtin_sqrtf(a[1]), __builtin_sqrtf(a[2]), __builtin_sqrtf(a[3])};
#endif
}

template <class AddressOf>
inline Reals blocks(const AddressOf& address_of) {
    return load<Reals>(address_of(0));
}

template <int q>
inline Reals lane_of_blocks(Reals lanes) {
    return all_lanes<Reals>(lanes[q]);
}

inline Words bytes_of_blocks(Integers a, Integers b, Integers c, Integers d) {
#if defined(__SSE2__)
    return (Words)_mm_packus_epi16(_mm_packs_epi32((__m128i)a, (__m128i)b), _mm_packs_epi32((__m128i)c, (__m128i)d));
#else
    const auto bytes = [](Integers block) {
        return static_cast<std::uint32_t>(block[0] | block[1] << 8 | block[2] << 16) | std::uint32_t(block[3]) << 24;
    };
    return Words{bytes(a), bytes(b), bytes(c), bytes(d)};
#endif
}

inline void store_pairs(std::uint64_t* numbers, Words low, Words high, bool descending) {
    if (descending) {
        low = __builtin_shufflevector(low, low, 3, 2, 1, 0), high = __builtin_shufflevector(high, high, 3, 2, 1, 0);
    }
    store(numbers, __builtin_shufflevector(low, high, 0, 4, 1, 5));
    store(numbers + 2, __builtin_shufflevector(low, high, 2, 6, 3, 7));
}

#endif

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
