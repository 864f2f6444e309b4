// Shaded packets and row runs decoded (protocol/rules/packet_layout.py).
#pragma once

#include "splat_server/kernels/splat_job.h"

namespace volsplat::VOLSPLAT_PATH {

namespace {

// A packet's x and y from its run's origin, 1/64 pixel.
inline std::int64_t x_of(std::uint64_t packet) { return static_cast<std::int64_t>(packet & kPositionMask); }
inline std::int64_t y_of(std::uint64_t packet) {
    return static_cast<std::int64_t>(packet >> kPositionBits & kPositionMask);
}

inline std::uint64_t packet_at(const unsigned char* address) {
    std::uint64_t packet;
    __builtin_memcpy(&packet, address, sizeof packet);
    return packet;
}

// The packets of a run that may reach the job's rows, where each reaches so many rows up and down. The samples of a run
// lie on a line, in order, so they are found by halving; of a run that is no line, it is some of them.
struct PacketRange {
    std::uint64_t begin, end;
};

inline PacketRange packets_in_rows(const SplatJob& job, const RowRun& run, const unsigned char* packets,
                                   std::int64_t reach) {
    const auto y_at = [&](std::uint64_t n) { return run.y0 + y_of(packet_at(packets + n * kPacketBytes)); };
    const std::int64_t least = (std::int64_t(job.row_begin) - reach) * (1 << kSubpixelBits);
    const std::int64_t greatest = (std::int64_t(job.row_end) + reach) * (1 << kSubpixelBits);
    const bool rises = y_at(run.count - 1) >= y_at(0);
    // The first packet that is not before the rows, and the first that is behind them
    const auto first = [&](std::uint64_t begin, std::int64_t bound, bool of_bound) {
        std::uint64_t end = run.count;
        while (begin < end) {
            const std::uint64_t middle = begin + (end - begin) / 2;
            const std::int64_t y = y_at(middle);
            if (rises ? y > bound || (of_bound && y == bound) : y < bound || (of_bound && y == bound)) end = middle;
            else begin = middle + 1;
        }
        return begin;
    };
    const std::uint64_t begin = first(0, rises ? least : greatest, true);
    return {begin, first(begin, rises ? greatest : least, false)};
}

struct ShadedSample {
    std::int64_t x, y;  // 1/64 pixel
    float opacity, red, green, blue;
};

inline ShadedSample sample_at(const unsigned char* address, const RowRun& run, const SplatJob& job) {
    const std::uint64_t packet = packet_at(address);
    const auto channel = [&](int n) {
        return static_cast<float>(static_cast<int>(packet >> (kColourShift + 8 * n) & 255)) / 255.0f;
    };
    return {run.x0 + x_of(packet),
            run.y0 + y_of(packet),
            job.opacities[packet >> kOpacityShift & kOpacityMask],
            channel(0),
            channel(1),
            channel(2)};
}

// Eight packets at once, each as two words of 32 bits.
constexpr int kAtOnce = 8;
typedef std::int32_t Integers __attribute__((vector_size(kAtOnce * 4)));
typedef std::uint32_t Words __attribute__((vector_size(kAtOnce * 4)));
typedef float Numbers __attribute__((vector_size(kAtOnce * 4)));

struct Packets {
    Words low, high;

    Integers x() const { return (Integers)(low & kPositionMask); }
    Integers y() const { return (Integers)(low >> kPositionBits & kPositionMask); }
    Numbers red() const { return channel(high >> 8 & 255); }
    Numbers green() const { return channel(high >> 16 & 255); }
    Numbers blue() const { return channel(high >> 24); }

    // As protocol.packet_layout.opacity_of_code.
    Numbers opacity() const {
        const Words exponent = high >> 4 & 15, mantissa = (high << 4 | low >> kOpacityShift) & 255;
        const Words normal = (Words)(exponent > 0);  // all bits
        const Words units = (mantissa | (normal & 256)) << (exponent + normal);
        return __builtin_convertvector((Integers)units, Numbers) / static_cast<float>(kOpacityUnit);
    }

private:
    static Numbers channel(Words bytes) { return __builtin_convertvector((Integers)bytes, Numbers) / 255.0f; }
};

inline Packets packets_of(Words first, Words second) {
    return {__builtin_shufflevector(first, second, 0, 2, 4, 6, 8, 10, 12, 14),
            __builtin_shufflevector(first, second, 1, 3, 5, 7, 9, 11, 13, 15)};
}

inline Packets packets_at(const unsigned char* address) {
    Words first, second;
    __builtin_memcpy(&first, address, sizeof first);
    __builtin_memcpy(&second, address + sizeof first, sizeof second);
    return packets_of(first, second);
}

// Fewer than eight, and zeros behind them.
inline Packets last_packets_at(const unsigned char* address, int count) {
    Words words[2] = {};
    __builtin_memcpy(words, address, count * kPacketBytes);
    return packets_of(words[0], words[1]);
}

}  // namespace

}  // namespace volsplat::VOLSPLAT_PATH
