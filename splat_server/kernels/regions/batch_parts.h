// Where in a batch's memory its parts lie: of each region the row runs, then the packets.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/channels/batch_channels.h"
#include "source_rules.h"

namespace volsplat {

// Adds the parts, one after the other from `place` on. Returns how many bytes they take. Throws std::invalid_argument
// if those are more than there are.
std::size_t lay_out(std::span<const PartCounts> counts, const unsigned char* place, std::size_t bytes,
                    std::vector<PartView>& parts);

// Where a sender may still write to its batch, the runs, which must stay as they are checked, are copied, and the parts
// have the copies; packets may be any bits at any time.
std::vector<unsigned char> copied_runs(std::vector<PartView>& parts);

}  // namespace volsplat
