// Finds the gaps between a run's packets by their positions, and checks by its ends that the lattice gives them back.
#include "batch_encoder.h"

#include <algorithm>
#include <cstdlib>

namespace volsplat {

namespace {

constexpr double kWireUnit = std::int64_t{1} << kFinerBits;  // 1/64 pixel
constexpr double kLeastApart = 4;                            // wire units: both ends of a gap are rounded by half a one
constexpr std::uint64_t kPositions = std::uint64_t{1} << 2 * kPositionBits;

std::uint64_t packet_at(const unsigned char* packets, std::size_t n) {
    std::uint64_t packet;
    std::memcpy(&packet, packets + n * sizeof packet, sizeof packet);
    return packet;
}

std::uint64_t opacity_of(std::uint64_t packet) { return packet >> kOpacityShift & kOpacityMask; }

// The packet's bits, if both offsets are within what these can say.
std::uint64_t position_of(const SampleLattice::Point& point, const RowRun& run) {
    return static_cast<std::uint64_t>(on_wire(point[0]) - run.x0) +
           (static_cast<std::uint64_t>(on_wire(point[1]) - run.y0) << kPositionBits);
}

}  // namespace

BatchEncoder::BatchEncoder(const SampleLattice& lattice) : lattice_(lattice) {
    const auto& [x, y] = lattice.levels[2].step;
    const auto step_x = static_cast<std::int64_t>(x), step_y = static_cast<std::int64_t>(y);
    const bool by_x = std::abs(step_x) >= std::abs(step_y);
    const double apart = static_cast<double>(by_x ? step_x : step_y) / kWireUnit;
    if (std::abs(apart) < kLeastApart) throw std::invalid_argument("samples are less than 1/16 pixel apart");
    steps_ = {by_x ? 0 : kPositionBits, static_cast<float>(1 / apart)};
}

BatchEncoder::Code BatchEncoder::encode(const std::vector<RawPart>& parts) {
    std::size_t runs = 0, packets = 0;
    for (const RawPart& part : parts) runs += part.run_count, packets += part.packet_count;
    code_.resize(std::max(code_.size(), largest_code(runs, packets)));
    palette_.clear();
    places_.fill(kUnused);

    unsigned char* const lattice = code_.data() + kLongestPalette;
    std::memcpy(lattice, &lattice_, sizeof lattice_);
    unsigned char* const opacities = lattice + sizeof lattice_;
    unsigned char *const gaps = opacities + packets, *const colours = gaps + packets;
    std::size_t done = 0;
    for (const RawPart& part : parts) {
        put_opacities(part, opacities + done);
        put_gaps(part, gaps + done);
        put_colours(part, colours + kColourBytes * done);
        done += part.packet_count;
    }
    unsigned char* end = colours + kColourBytes * packets;
    done = 0;
    for (const RawPart& part : parts) {
        end = put_runs(part, gaps + done, end);
        done += part.packet_count;
    }
    done = 0;
    for (const RawPart& part : parts) {
        end = put_wide_gaps(part, gaps + done, end);
        done += part.packet_count;
    }
    if (palette_.size() > kShortPalette) {
        for (const RawPart& part : parts) end = put_high_places(part, end);
    }

    // Only now is it known how long the palette is
    const auto count = static_cast<PaletteNumber>(palette_.size());
    unsigned char* const begin = lattice - (1 + count) * sizeof count;
    std::memcpy(begin, &count, sizeof count);
    if (count) std::memcpy(begin + sizeof count, palette_.data(), count * sizeof count);
    return {begin, static_cast<std::size_t>(end - begin)};
}

// The low byte of each place in the palette.
void BatchEncoder::put_opacities(RawPart part, unsigned char* to) {
    for (std::size_t n = 0; n < part.packet_count; ++n) {
        const std::uint64_t opacity = opacity_of(packet_at(part.packets, n));
        PaletteNumber place = places_[opacity];
        if (place == kUnused) place = place_in_palette(opacity);
        to[n] = static_cast<unsigned char>(place);
    }
}

PaletteNumber BatchEncoder::place_in_palette(std::uint64_t opacity) {
    const auto place = static_cast<PaletteNumber>(palette_.size());
    palette_.push_back(static_cast<PaletteNumber>(opacity));
    return places_[opacity] = place;
}

unsigned char* BatchEncoder::put_high_places(const RawPart& part, unsigned char* to) const {
    for (std::size_t n = 0; n < part.packet_count; ++n) {
        *to++ = static_cast<unsigned char>(places_[opacity_of(packet_at(part.packets, n))] >> 8);
    }
    return to;
}

// Writes a byte too far.
void BatchEncoder::put_colours(RawPart part, unsigned char* to) const {
    for (std::size_t n = 0; n < part.packet_count; ++n) {
        const auto colour = static_cast<std::uint32_t>(packet_at(part.packets, n) >> kColourShift);
        std::memcpy(to + kColourBytes * n, &colour, sizeof colour);
    }
}

// From the packet before, whatever run that is in; the first of each run has none.
void BatchEncoder::put_gaps(RawPart part, unsigned char* to) const {
    const SampleSteps steps = steps_;  // where no byte that is written may be a part of it
    for (std::size_t n = 1; n < part.packet_count; ++n) {
        const std::int32_t gap = steps.between(packet_at(part.packets, n - 1), packet_at(part.packets, n)) - 1;
        to[n] = static_cast<unsigned char>(gap < 0 ? 0 : gap < kWideGap ? gap : kWideGap);
    }
}

// Each run by what it differs in from the one before.
unsigned char* BatchEncoder::put_runs(const RawPart& part, unsigned char* gaps, unsigned char* to) const {
    const std::uint64_t rows = lattice_.levels[1].last + 1;
    std::uint64_t row_before = 0, first_before = 0;
    std::size_t done = 0;
    for (std::size_t n = 0; n < part.run_count; ++n) {
        const RowRun run = run_at(part.runs, n);
        if (run.count == 0 || run.count > part.packet_count - done) {
            throw std::invalid_argument("a run has more packets than there are, or none");
        }
        check_ends(run, part.packets + done * kPacketBytes);
        gaps[done] = 0;
        done += run.count;
        const std::uint64_t row = run.sheet * rows + run.row;
        to = put_varint(to, row - row_before);
        to = put_varint(to, zigzag(static_cast<std::int64_t>(run.first - first_before)));
        to = put_varint(to, run.count);
        row_before = row;
        first_before = run.first;
    }
    if (done != part.packet_count) throw std::invalid_argument("packets are left that no run has");
    return to;
}

// The lattice must give the positions of a run's first and last packet back, and its origin.
void BatchEncoder::check_ends(const RowRun& run, const unsigned char* packets) const {
    const std::uint64_t head = packet_at(packets, 0) % kPositions,
                        tail = packet_at(packets, run.count - 1) % kPositions;
    const SampleLattice::Point first = lattice_.first_of(run);
    const auto steps = static_cast<std::uint64_t>(steps_.between(head, tail));
    SampleLattice::Point last;
    for (int axis = 0; axis < 2; ++axis) last[axis] = first[axis] + steps * lattice_.levels[2].step[axis];
    const bool origin = std::min(on_wire(first[0]), on_wire(last[0])) == run.x0 &&
                        std::min(on_wire(first[1]), on_wire(last[1])) == run.y0;
    if (!origin || run.row > lattice_.levels[1].last || position_of(first, run) != head ||
        position_of(last, run) != tail) {
        throw std::invalid_argument("a run is not on the frame's lattice");
    }
}

// What does not fit into a byte, of those that say so.
unsigned char* BatchEncoder::put_wide_gaps(const RawPart& part, const unsigned char* gaps, unsigned char* to) const {
    const unsigned char *const end = gaps + part.packet_count, *at = gaps;
    while ((at = static_cast<const unsigned char*>(std::memchr(at, kWideGap, static_cast<std::size_t>(end - at))))) {
        const auto n = static_cast<std::size_t>(at++ - gaps);
        const std::int32_t gap = steps_.between(packet_at(part.packets, n - 1), packet_at(part.packets, n)) - 1;
        to = put_varint(to, static_cast<std::uint64_t>(gap - kWideGap));
    }
    return to;
}

}  // namespace volsplat
