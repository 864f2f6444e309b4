// Gives coded batches their runs and packets back: see kernels/batch_code.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/packet_layout.h"

namespace volsplat {

// Room for what a batch has for one region.
struct DecodedPart {
    RowRun* runs;
    std::size_t run_count;
    std::uint64_t* packets;
    std::size_t packet_count;
};

// Fills the parts. Throws std::invalid_argument where the code is not one of so many runs and packets.
void decode_batch(const unsigned char* code, std::size_t count, const std::vector<DecodedPart>& parts);

}  // namespace volsplat
