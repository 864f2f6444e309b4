// Writes batches without what follows from the frame's lattice: see kernels/batch_code.h.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/batch_code.h"
#include "kernels/large_memory.h"

namespace volsplat {

class BatchEncoder {
public:
    // Throws std::invalid_argument if samples of a row are too near to each other to tell them apart by their
    // positions.
    explicit BatchEncoder(const SampleLattice& lattice);

    struct Code {
        const unsigned char* bytes;
        std::size_t count;
    };

    // Valid until the next call. Throws std::invalid_argument for what is not on the lattice.
    Code encode(const std::vector<RawPart>& parts);

private:
    // Samples from one packet to another of its run, by their offsets on the axis on which samples are further apart.
    struct SampleSteps {
        int shift;  // of that offset in a packet
        float of_offset;

        std::int32_t between(std::uint64_t from, std::uint64_t to) const {
            return static_cast<std::int32_t>(static_cast<float>(offset(to) - offset(from)) * of_offset + 0.5F);
        }
        std::int32_t offset(std::uint64_t packet) const {
            return static_cast<std::int32_t>(packet >> shift & kPositionMask);
        }
    };

    static constexpr PaletteNumber kUnused = 0xffff;

    void put_opacities(RawPart part, unsigned char* to);
    PaletteNumber place_in_palette(std::uint64_t opacity);
    void put_gaps(RawPart part, unsigned char* to) const;
    void put_colours(RawPart part, unsigned char* to) const;
    unsigned char* put_runs(const RawPart& part, unsigned char* gaps, unsigned char* to) const;
    void check_ends(const RowRun& run, const unsigned char* packets) const;
    unsigned char* put_wide_gaps(const RawPart& part, const unsigned char* gaps, unsigned char* to) const;
    unsigned char* put_high_places(const RawPart& part, unsigned char* to) const;

    SampleLattice lattice_;
    SampleSteps steps_;
    std::vector<unsigned char> code_;
    std::vector<PaletteNumber> palette_;
    std::array<PaletteNumber, kOpacityCodes> places_;  // of opacity codes in the palette
};

}  // namespace volsplat
