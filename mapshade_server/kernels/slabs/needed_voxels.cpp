// Running minima and maxima, along each axis for a box, and sheet by sheet for what has another shape.
#include "needed_voxels.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <vector>

#include "kernels/compiler.h"
#include "kernels/packet_layout.h"

namespace volsplat {

namespace {

constexpr std::int64_t kLongest = std::numeric_limits<std::uint16_t>::max() + 1;
constexpr std::uint8_t kDensest = 255;

typedef std::vector<std::uint8_t> Bytes;

struct Least {
    std::uint8_t operator()(std::uint8_t a, std::uint8_t b) const { return a < b ? a : b; }
};

struct Greatest {
    std::uint8_t operator()(std::uint8_t a, std::uint8_t b) const { return a < b ? b : a; }
};

std::int64_t distance(const Index3& size, int axis) { return axis == 0 ? 1 : axis == 1 ? size[0] : size[0] * size[1]; }

// Each becomes the extreme of what lies up to `shift` away along the axis, if it was that of itself and its neighbours.
template <class Extreme>
void widen(const Bytes& from, Bytes& to, const Index3& size, int axis, std::int64_t shift) {
    const Extreme extreme;
    const std::int64_t step = distance(size, axis), line = step * size[axis], count = from.size();
    const std::int64_t inner = shift * step;
    for (std::int64_t begin = 0; begin < count; begin += line) {
        const std::uint8_t* in = from.data() + begin;
        std::uint8_t* out = to.data() + begin;
        std::copy(in, in + line, out);
        if (inner >= line) {
            continue;
        }
        for (std::int64_t n = 0; n < line - inner; ++n) out[n] = extreme(out[n], in[n + inner]);
        for (std::int64_t n = inner; n < line; ++n) out[n] = extreme(out[n], in[n - inner]);
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
        const Extreme extreme;
        const std::int64_t length = size_[0];
        std::copy_n(sheet, length * size_[1], at(k, 0));
        for (std::int64_t shift = 1; shift <= reach_; ++shift)
            for (std::int64_t j = 0; j < size_[1]; ++j) {
                const std::uint8_t *const in = sheet + j * length, *const before = at(k, shift - 1) + j * length;
                std::uint8_t* const out = at(k, shift) + j * length;
                std::copy_n(before, length, out);
                VOLSPLAT_INDEPENDENT
                for (std::int64_t n = 0; n < length - shift; ++n) out[n] = extreme(out[n], in[n + shift]);
                VOLSPLAT_INDEPENDENT
                for (std::int64_t n = shift; n < length; ++n) out[n] = extreme(out[n], in[n - shift]);
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
    const Extreme extreme;
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
                VOLSPLAT_INDEPENDENT
                for (std::int64_t n = 0; n < count; ++n) to[n] = extreme(to[n], in[n]);
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

// For each density the least one from it on that can be seen; 256 if there is none.
std::array<int, 256> next_visible(const Need& need) {
    std::array<int, 256> next;
    int found = 256;
    for (int density = kDensest; density >= 0; --density) {
        if (need.visible[density / 64] >> (density % 64) & 1) found = density;
        next[density] = found;
    }
    return next;
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

// What densities may be where those of the voxels around are these.
void overshoot(Bytes& least, Bytes& greatest, const Bytes& edge, const Need& need) {
    std::array<int, 256> more[2];  // by what lies between them: inside, and at edges
    for (int between = 0; between <= kDensest; ++between) {
        more[0][between] = static_cast<int>(std::ceil(std::min(between * need.overshoot, 255.0)));
        more[1][between] = static_cast<int>(std::ceil(std::min(between * need.edge_overshoot, 255.0)));
    }
    for (std::size_t n = 0; n < least.size(); ++n) {
        if (greatest[n] <= least[n]) continue;
        const int by = more[edge[n]][greatest[n] - least[n]];
        least[n] = static_cast<std::uint8_t>(std::max(least[n] - by, 0));
        greatest[n] = static_cast<std::uint8_t>(std::min(greatest[n] + by, 255));
    }
}

// Where voxels around have no data, or lie outside of the volume.
Bytes edges(const std::uint32_t* packets, const Index3& size, const Need& need) {
    Bytes found(size[0] * size[1] * size[2]);
    for (std::size_t n = 0; n < found.size(); ++n) found[n] = packets[n] >> kNoDataBit;
    widen<Greatest>(found, size, need.look);
    const Index3 look = need.look.reach();
    Index3 begin, end;
    for (int axis = 0; axis < 3; ++axis) {
        begin[axis] = need.before[axis] ? 0 : look[axis];
        end[axis] = size[axis] - (need.behind[axis] ? 0 : look[axis]);
    }
    mark_outside(found, size, begin, end);
    return found;
}

// Where the densities around enclose one that can be seen.
Bytes showing(const std::uint32_t* packets, const Index3& size, const Need& need) {
    const std::size_t count = size[0] * size[1] * size[2];
    Bytes least(count), greatest(count);
    for (std::size_t n = 0; n < count; ++n) {
        const bool no_data = packets[n] >> kNoDataBit;
        const auto density = static_cast<std::uint8_t>(packets[n]);
        least[n] = no_data ? kDensest : density;
        greatest[n] = no_data ? 0 : density;
    }
    widen<Least>(least, size, need.look);
    widen<Greatest>(greatest, size, need.look);
    if (need.overshoot > 0) overshoot(least, greatest, edges(packets, size, need), need);
    const std::array<int, 256> next = next_visible(need);
    for (std::size_t n = 0; n < count; ++n) greatest[n] = next[least[n]] <= greatest[n];
    return greatest;
}

// What lies so near to a face that it may be needed for what is beyond.
void add_faces(Bytes& needed, const Index3& size, const Need& need) {
    Index3 begin, end;
    const Index3 look = need.look.reach(), spread = need.spread.reach();
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t near = look[axis] + spread[axis];
        begin[axis] = need.before[axis] ? near : 0;
        end[axis] = size[axis] - (need.behind[axis] ? near : 0);
    }
    mark_outside(needed, size, begin, end);
}

Bytes needed_of(const std::uint32_t* packets, const Index3& size, const Need& need) {
    Bytes needed = showing(packets, size, need);
    widen<Greatest>(needed, size, need.spread);
    add_faces(needed, size, need);
    for (std::size_t n = 0; n < needed.size(); ++n) needed[n] &= !(packets[n] >> kNoDataBit);
    return needed;
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

NeededRows::NeededRows(const std::uint32_t* packets, const std::uint8_t* needed, const Index3& size, int axis)
    : size_(size), low_(axis == 0 ? 1 : 0), high_(axis == 2 ? 1 : 2) {
    const int low = low_, high = high_;
    const std::size_t rows = size[low] * size[high];
    const std::int64_t along = distance(size, axis), across = distance(size, low), up = distance(size, high);
    // Whichever axis it is, memory is read in its order
    const auto each = [&](auto&& take) {
        for (std::int64_t h = 0; h < size[high]; ++h) {
            if (axis == 0) {
                for (std::int64_t l = 0; l < size[low]; ++l)
                    for (std::int64_t n = 0; n < size[axis]; ++n) take(h * size[low] + l, n, h * up + l * across + n);
            } else {
                for (std::int64_t n = 0; n < size[axis]; ++n)
                    for (std::int64_t l = 0; l < size[low]; ++l) take(h * size[low] + l, n, h * up + n * along + l);
            }
        }
    };
    begins_ = large_array<std::uint64_t>(rows + 2);
    std::fill(begins_.get(), begins_.get() + rows + 2, 0);
    std::uint64_t* const after = begins_.get() + 2;
    each([&](std::size_t row, std::int64_t, std::size_t place) { after[row] += needed[place]; });
    for (std::size_t row = 1; row < rows; ++row) after[row] += after[row - 1];
    const std::uint64_t count = rows ? after[rows - 1] : 0;
    voxels_ = large_array<NeededVoxel>(count + 1);
    // From now on the place before a row's end is where its next voxel goes
    std::uint64_t* const next = begins_.get() + 1;
    each([&](std::size_t row, std::int64_t n, std::size_t place) {
        if (!needed[place]) return;
        voxels_[next[row]++] = {static_cast<std::uint16_t>(n), static_cast<std::uint8_t>(packets[place])};
    });
}

NeededVoxels::NeededVoxels(const Index3& size) : size_(size) {
    if (*std::max_element(size.begin(), size.end()) > kLongest)
        throw std::invalid_argument("a sub-cube for slabs is 65536 voxels long at most");
}

std::shared_ptr<const NeededRows> NeededVoxels::rows_along(int axis, const Need& need, const std::uint32_t* packets) {
    const std::lock_guard locked(mutex_);
    if (!rows_ || axis != axis_ || need != need_) {
        rows_.reset();
        const Bytes needed = needed_of(packets, size_, need);
        rows_ = std::make_shared<NeededRows>(packets, needed.data(), size_, axis);
        axis_ = axis, need_ = need;
    }
    return rows_;
}

}  // namespace volsplat
