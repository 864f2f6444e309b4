#include "level_columns.h"

#include <cmath>

#include "kernels/constants.h"
#include "kernels/tables/patch_table.h"

namespace volsplat {

namespace {

constexpr double kApart = 0.25;         // of the finer light is that of columns for themselves
constexpr double kHidden = 1.0 / 1024;  // as little as freezes a pixel

// A table of three numbers to an entry.
class Look {
public:
    explicit Look(const double* table) : table_(table) {}

    const double* entry(std::uint32_t packet) const { return table_ + 3 * (packet & (kPlaneEntries - 1)); }

private:
    const double* table_;
};

// One column, seen from its end.
class Sight {
public:
    Sight(SeenLight& light, Look look, double share) : light_(light), look_(look), share_(share) {}

    void begin() { through_ = 1.0; }
    double through() const { return through_; }

    // A layer of as many places, of which some have these packets.
    void layer(const std::uint32_t* const* packets, int count, double places) {
        double depth = 0.0;
        for (int n = 0; n < count; ++n) depth += look_.entry(*packets[n])[0];
        if (depth == 0.0) return;
        const double left = through_ * std::exp(-depth / places), seen = share_ * (through_ - left) / depth;
        for (int n = 0; n < count; ++n) {
            const double* const entry = look_.entry(*packets[n]);
            const double part = seen * entry[0];
            light_.emitted += part * entry[1];
            light_.reflected[*packets[n] >> kDirectionShift & (kDirectionCodes - 1)] += part * entry[2];
        }
        through_ = left;
    }

private:
    SeenLight& light_;
    Look look_;
    double share_;
    double through_ = 1.0;
};

bool has_data(std::uint32_t packet) { return packet >> kNoDataBit == 0; }

}  // namespace

SeenOfLevels seen_in_columns(const ColumnView& view, const double* finer, const double* coarser) {
    SeenOfLevels seen;
    for (SeenLight* light : {&seen.finer, &seen.coarser}) light->reflected.resize(kDirectionCodes);
    Sight fine(seen.finer, Look(finer), 1.0 - kApart), coarse(seen.coarser, Look(coarser), 1.0);
    std::vector<Sight> apart(4, Sight(seen.finer, Look(finer), kApart / view.places));
    const double children = view.layers * view.places;
    const std::uint32_t* packets[8];
    for (std::size_t column = 0; column < view.columns; ++column) {
        fine.begin();
        for (Sight& sight : apart) sight.begin();
        coarse.begin();
        for (std::size_t n = 0; n < view.depth && (fine.through() > kHidden || coarse.through() > kHidden); ++n) {
            const std::size_t at = view.from_high ? view.depth - 1 - n : n;
            const std::uint32_t* const row = view.rows + (column * view.depth + at) * ColumnView::kRow;
            int there = 0;
            for (int child = 1; child < ColumnView::kRow; ++child) there += row[child] != ColumnView::kBeyond;
            packets[0] = row;
            if (has_data(*row) && there > 0) coarse.layer(packets, 1, children / there);
            for (int layer = 0; layer < 2; ++layer) {
                const int side = view.from_high ? 1 - layer : layer;
                int count = 0, place = 0;
                for (int child = 0; child < 8; ++child) {
                    if ((child >> view.axis & 1) != side) continue;
                    Sight& sight = apart[place++];
                    if (!has_data(row[child + 1])) continue;
                    packets[count] = row + child + 1;
                    sight.layer(packets + count, 1, 1.0);
                    ++count;
                }
                fine.layer(packets, count, view.places);
            }
        }
    }
    return seen;
}

}  // namespace volsplat
