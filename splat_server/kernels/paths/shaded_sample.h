// One sample as the splat loops use it, decoded from its shaded packet and row run (protocol/packet_layout.py).
#pragma once
#include "../splat_job.h"

namespace volsplat {
namespace VOLSPLAT_PATH {
namespace {

typedef float Sample4 __attribute__((vector_size(16)));
typedef int32_t Integer4 __attribute__((vector_size(16)));

struct ShadedSample {
    int64_t x, y;  // 1/64 pixel
    float opacity;
    Sample4 intensity;  // red, green, blue in 0..1, and 1
};

inline RowRun run_at(const unsigned char* runs, uint64_t n) {
    RowRun run;
    __builtin_memcpy(&run, runs + n * sizeof run, sizeof run);
    return run;
}

inline ShadedSample sample_at(const unsigned char* address, const RowRun& run, const float* opacities) {
    uint64_t packet;
    __builtin_memcpy(&packet, address, sizeof packet);
    const Integer4 bytes = {static_cast<int32_t>(packet >> kColourShift & 255),
                            static_cast<int32_t>(packet >> (kColourShift + 8) & 255),
                            static_cast<int32_t>(packet >> (kColourShift + 16)), 255};
    return {int64_t(run.x0) + static_cast<int64_t>(packet & kPositionMask),
            int64_t(run.y0) + static_cast<int64_t>(packet >> 14 & kPositionMask),
            opacities[packet >> kOpacityShift & kOpacityMask], __builtin_convertvector(bytes, Sample4) / 255.0f};
}

}  // namespace
}  // namespace VOLSPLAT_PATH
}  // namespace volsplat
