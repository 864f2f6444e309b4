#include "batch_parts.h"

#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

namespace volsplat {

std::size_t lay_out(std::span<const PartCounts> counts, const unsigned char* place, std::size_t bytes,
                    std::vector<PartView>& parts) {
    std::size_t left = bytes;
    for (const auto& [runs, packets] : counts) {
        if (runs > left / sizeof(RowRun) || packets > (left - runs * sizeof(RowRun)) / kPacketBytes)
            throw std::invalid_argument("the parts of a batch are longer than its " + std::to_string(bytes) + " bytes");
        const unsigned char* const first_packet = place + runs * sizeof(RowRun);
        parts.push_back({{place, first_packet, runs}, packets});
        place = first_packet + packets * kPacketBytes;
        left -= PartCounts{runs, packets}.bytes();
    }
    return bytes - left;
}

std::vector<unsigned char> copied_runs(std::vector<PartView>& parts) {
    std::size_t runs = 0;
    for (const PartView& part : parts) runs += part.runs.run_count;
    std::vector<unsigned char> copies(runs * sizeof(RowRun));
    unsigned char* place = copies.data();
    for (PartView& part : parts) {
        const std::size_t bytes = part.runs.run_count * sizeof(RowRun);
        if (bytes) std::memcpy(place, part.runs.runs, bytes);
        part.runs.runs = std::exchange(place, place + bytes);
    }
    return copies;
}

}  // namespace volsplat
