// Running minima and maxima, along each axis for a box, and sheet by sheet for what has another shape.
#include "needed_voxels.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "kernels/compiler.h"
#include "kernels/packet_layout.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"

namespace volsplat {

namespace {

constexpr std::uint8_t kDensest = 255;

struct Least {
    static void of(const std::uint8_t* other, std::size_t n, std::uint8_t* bytes) {
        map_shade_kernels().least(other, n, bytes);
    }
};

struct Greatest {
    static void of(const std::uint8_t* other, std::size_t n, std::uint8_t* bytes) {
        map_shade_kernels().greatest(other, n, bytes);
    }
};

std::int64_t distance(const Index3& size, int axis) { return axis == 0 ? 1 : axis == 1 ? size[0] : size[0] * size[1]; }

// Each becomes the extreme of what lies up to `shift` away along the axis, if it was that of itself and its neighbours.
template <class Extreme>
void widen(const Bytes& from, Bytes& to, const Index3& size, int axis, std::int64_t shift) {
    const std::int64_t step = distance(size, axis), line = step * size[axis], count = from.size();
    const std::int64_t inner = shift * step;
    for (std::int64_t begin = 0; begin < count; begin += line) {
        const std::uint8_t* in = from.data() + begin;
        std::uint8_t* out = to.data() + begin;
        std::copy(in, in + line, out);
        if (inner >= line) continue;
        Extreme::of(in + inner, line - inner, out);
        Extreme::of(in, line - inner, out + inner);
    }
}

// The extremes of all that lies so far away along each axis.
template <class Extreme>
void widen(Bytes& bytes, const Index3& size, const Index3& radius) {
    Bytes other(bytes.size());
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t most = std::min(radius[axis], size[axis] - 1);
        for (std::int64_t done = 0; done < most;) {
            const std::int64_t shift = std::min(2 * done + 1, most - done);
            widen<Extreme>(bytes, other, size, axis, shift);
            bytes.swap(other);
            done += shift;
        }
    }
}

// Sheets of a box, each row of them widened along i by 0, 1, … places: those around one sheet.
template <class Extreme>
class WidenedSheets {
public:
    WidenedSheets(const Index3& size, std::int64_t reach, std::int64_t around)
        : size_(size), reach_(reach), around_(around), sheets_((reach + 1) * (2 * around + 1)) {
        for (Bytes& sheet : sheets_) sheet.resize(size[0] * size[1]);
    }

    void take(std::int64_t k, const std::uint8_t* sheet) {
        const std::int64_t length = size_[0];
        std::copy_n(sheet, length * size_[1], at(k, 0));
        for (std::int64_t shift = 1; shift <= reach_; ++shift)
            for (std::int64_t j = 0; j < size_[1]; ++j) {
                const std::uint8_t *const in = sheet + j * length, *const before = at(k, shift - 1) + j * length;
                std::uint8_t* const out = at(k, shift) + j * length;
                std::copy_n(before, length, out);
                if (shift >= length) continue;
                Extreme::of(in + shift, length - shift, out);
                Extreme::of(in, length - shift, out + shift);
            }
    }

    std::uint8_t* at(std::int64_t k, std::int64_t shift) {
        return sheets_[k % (2 * around_ + 1) * (reach_ + 1) + shift].data();
    }

private:
    const Index3 size_;
    const std::int64_t reach_, around_;
    std::vector<Bytes> sheets_;
};

// The extremes of all that a shape holds, which is put around each.
template <class Extreme>
void widen(Bytes& bytes, const Index3& size, const std::vector<std::vector<std::int64_t>>& shape) {
    std::int64_t reach = 0;
    for (const auto& row : shape) reach = std::max(reach, *std::max_element(row.begin(), row.end()));
    const auto last_k = static_cast<std::int64_t>(shape.size()) - 1;
    const std::int64_t sheet = size[0] * size[1];
    WidenedSheets<Extreme> sheets(size, reach, last_k);
    for (std::int64_t k = 0, taken = 0; k < size[2]; ++k) {
        for (; taken < size[2] && taken <= k + last_k; ++taken) sheets.take(taken, bytes.data() + taken * sheet);
        std::uint8_t* const out = bytes.data() + k * sheet;
        std::copy_n(sheets.at(k, shape[0][0]), sheet, out);
        for (std::int64_t other = std::max<std::int64_t>(k - last_k, 0); other <= std::min(k + last_k, size[2] - 1);
             ++other) {
            const auto& row = shape[std::abs(other - k)];
            const std::int64_t last_j = std::min<std::int64_t>(row.size(), size[1]) - 1;
            for (std::int64_t j = -last_j; j <= last_j; ++j) {
                const std::uint8_t* const in =
                    sheets.at(other, row[std::abs(j)]) + std::max<std::int64_t>(j, 0) * size[0];
                std::uint8_t* const to = out + std::max<std::int64_t>(-j, 0) * size[0];
                const std::int64_t count = sheet - std::abs(j) * size[0];
                Extreme::of(in, count, to);
            }
        }
    }
}

template <class Extreme>
void widen(Bytes& bytes, const Index3& size, const Neighbourhood& neighbourhood) {
    if (bytes.empty()) return;
    widen<Extreme>(bytes, size, neighbourhood.box);
    widen<Extreme>(bytes, size, neighbourhood.shape);
}

struct Densities {
    std::uint8_t first, last;
};

// Those that can be seen, as ranges.
std::vector<Densities> visible_densities(const Need& need) {
    std::vector<Densities> ranges;
    for (int density = 0; density <= kDensest; ++density) {
        if (!(need.visible[density / 64] >> (density % 64) & 1)) continue;
        const auto seen = static_cast<std::uint8_t>(density);
        if (ranges.empty() || ranges.back().last + 1 < density) ranges.push_back({seen, seen});
        ranges.back().last = seen;
    }
    return ranges;
}

// All but what lies within a box.
void mark_outside(Bytes& marks, const Index3& size, const Index3& begin, const Index3& end) {
    std::uint8_t* row = marks.data();
    for (std::int64_t k = 0; k < size[2]; ++k)
        for (std::int64_t j = 0; j < size[1]; ++j, row += size[0]) {
            const bool inside = k >= begin[2] && k < end[2] && j >= begin[1] && j < end[1] && begin[0] < end[0];
            std::fill(row, row + (inside ? begin[0] : size[0]), 1);
            if (inside) std::fill(row + end[0], row + size[0], 1);
        }
}

struct Extremes {
    Bytes least, greatest;

    void widen(const Index3& size, const Neighbourhood& neighbourhood) {
        volsplat::widen<Least>(least, size, neighbourhood);
        volsplat::widen<Greatest>(greatest, size, neighbourhood);
    }
};

// What densities may be where those of the inner voxels are these, and those of all around the others.
void overshoot(Extremes& inner, const Extremes& around, const Bytes& edge, const Need& need) {
    std::array<int, 256> more[2];  // by what lies between them: inside, and at edges
    for (int between = 0; between <= kDensest; ++between) {
        more[0][between] = static_cast<int>(std::ceil(std::min(between * need.overshoot, 255.0)));
        more[1][between] = static_cast<int>(std::ceil(std::min(between * need.edge_overshoot, 255.0)));
    }
    for (std::size_t n = 0; n < edge.size(); ++n) {
        const int least = inner.least[n], greatest = inner.greatest[n];
        if (greatest < least) continue;  // none has data
        const int below = more[edge[n]][around.greatest[n] - least], above = more[edge[n]][greatest - around.least[n]];
        inner.least[n] = static_cast<std::uint8_t>(std::max(least - below, 0));
        inner.greatest[n] = static_cast<std::uint8_t>(std::min(greatest + above, 255));
    }
}

// What lies beyond a part's side: the rest of its box, another box, or nothing.
struct Sides {
    std::array<bool, 3> others_before, others_behind;
    std::array<bool, 3> nothing_before, nothing_behind;
};

Sides sides_of(const Part& part, const Index3& size, const Need& need) {
    Sides sides;
    for (int axis = 0; axis < 3; ++axis) {
        const bool first = part.low[axis] == 0, last = part.low[axis] + part.size[axis] == size[axis];
        sides.others_before[axis] = first && need.before[axis];
        sides.others_behind[axis] = last && need.behind[axis];
        sides.nothing_before[axis] = first && !need.before[axis];
        sides.nothing_behind[axis] = last && !need.behind[axis];
    }
    return sides;
}

// What is so near to these sides.
void mark_near(Bytes& marks, const Index3& size, const Index3& near, const std::array<bool, 3>& before,
               const std::array<bool, 3>& behind) {
    Index3 begin, end;
    for (int axis = 0; axis < 3; ++axis) {
        begin[axis] = before[axis] ? std::min(near[axis], size[axis]) : 0;
        end[axis] = size[axis] - (behind[axis] ? near[axis] : 0);
    }
    mark_outside(marks, size, begin, end);
}

// Of its packets, row by row of the part.
template <class Take>
void each_row(const std::uint32_t* packets, const Index3& size, const Part& part, const Take& take) {
    std::size_t n = 0;
    for (std::int64_t k = 0; k < part.size[2]; ++k)
        for (std::int64_t j = 0; j < part.size[1]; ++j, n += part.size[0])
            take(packets + ((part.low[2] + k) * size[1] + part.low[1] + j) * size[0] + part.low[0], n);
}

// Where voxels around have no data, or lie outside of the volume.
Bytes edges(const Bytes& no_data, const Part& part, const Sides& sides, const Need& need) {
    Bytes found = no_data;
    widen<Greatest>(found, part.size, need.look);
    mark_near(found, part.size, need.look.reach(), sides.nothing_before, sides.nothing_behind);
    return found;
}

// Where the densities around enclose one that can be seen.
Bytes showing(const std::uint32_t* packets, const Index3& size, const Part& part, const Sides& sides, const Need& need,
              const Bytes& no_data) {
    const std::size_t count = no_data.size();
    Extremes inner{Bytes(count), Bytes(count)};
    each_row(packets, size, part, [&](const std::uint32_t* row, std::size_t first) {
        for (std::int64_t n = 0; n < part.size[0]; ++n) {
            const auto density = static_cast<std::uint8_t>(row[n]);
            const auto lacking = static_cast<std::uint8_t>(-no_data[first + n]);  // all bits of it, or none
            inner.least[first + n] = density | lacking;
            inner.greatest[first + n] = density & ~lacking;
        }
    });
    if (need.overshoot > 0) {
        Extremes around = inner;
        around.widen(part.size, need.look);
        if (need.inner == need.look) inner = around;
        else inner.widen(part.size, need.inner);
        overshoot(inner, around, edges(no_data, part, sides, need), need);
    } else {
        inner.widen(part.size, need.look);
    }
    Bytes found(count);
    const std::uint8_t *const least = inner.least.data(), *const greatest = inner.greatest.data();
    for (const Densities& seen : visible_densities(need)) {
        VOLSPLAT_INDEPENDENT
        for (std::size_t n = 0; n < count; ++n) found[n] |= least[n] <= seen.last && greatest[n] >= seen.first;
    }
    return found;
}

}  // namespace

Index3 Neighbourhood::reach() const {
    Index3 found = box;
    for (const auto& row : shape) {
        found[0] = std::max(found[0], box[0] + *std::max_element(row.begin(), row.end()));
        found[1] = std::max(found[1], box[1] + static_cast<std::int64_t>(row.size()) - 1);
    }
    found[2] += static_cast<std::int64_t>(shape.size()) - 1;
    return found;
}

Bytes needed_marks(const std::uint32_t* packets, const Index3& size, const Part& part, const Need& need) {
    const Sides sides = sides_of(part, size, need);
    Bytes no_data(part.size[0] * part.size[1] * part.size[2]);
    each_row(packets, size, part, [&](const std::uint32_t* row, std::size_t first) {
        for (std::int64_t n = 0; n < part.size[0]; ++n) no_data[first + n] = row[n] >> kNoDataBit;
    });
    Bytes needed = showing(packets, size, part, sides, need, no_data);
    widen<Greatest>(needed, part.size, need.spread);
    // What lies so near to another box that it may be needed for what is beyond
    mark_near(needed, part.size, need.reach(), sides.others_before, sides.others_behind);
    for (std::size_t n = 0; n < needed.size(); ++n) needed[n] &= !no_data[n];
    return needed;
}

Index3 Need::reach() const {
    const Index3 looks = look.reach(), spreads = spread.reach();
    return {looks[0] + spreads[0], looks[1] + spreads[1], looks[2] + spreads[2]};
}

}  // namespace volsplat
