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

// For the cuts of the next frame's regions.
inline void count_work(const SplatJob& job, const RowRun& run, const unsigned char* packets) {
    const std::int64_t ends = y_of(packet_at(packets)) + y_of(packet_at(packets + (run.count - 1) * kPacketBytes));
    const std::int64_t middle = (2 * std::int64_t(run.y0) + ends) >> (kSubpixelBits + 1);
    const std::int64_t line = middle < job.row_begin ? job.row_begin : middle < job.row_end ? middle : job.row_end - 1;
    job.work[line / kTileSide] += run.count;
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
