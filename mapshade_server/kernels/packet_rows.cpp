// Finds rows in place where they are contiguous, and turns strips of columns into rows where they are not.
#include "packet_rows.h"

#include <algorithm>

#include "cpu_path.h"

namespace volsplat {

PacketRows::PacketRows(const PacketBox& box, const WalkPlan& plan) : box_(box), plan_(plan) {
  const std::int64_t by_axis[3] = {1, box.size[0], box.size[0] * box.size[1]};
  for (int level = 0; level < 3; ++level) {
    const int axis = plan.axes[level];
    const AxisVisits& visits = plan.visits[axis];
    ordinals_[level] = {visits.ordinal_from(box.low[axis]), visits.ordinal_from(box.low[axis] + box.size[axis])};
    strides_[level] = by_axis[axis];
  }
  sample_stride_ = strides_[2] * plan.visits_of(2).stride;
  // Rows a power of two apart would fall on the same lines of the cache
  pitch_ = ordinals_[2].count() + kStripLanes;
}

bool PacketRows::empty() const {
  return ordinals_[0].count() <= 0 || ordinals_[1].count() <= 0 || ordinals_[2].count() <= 0;
}

std::int64_t PacketRows::local(int level, std::int64_t ordinal) const {
  const int axis = plan_.axes[level];
  return plan_.visits[axis].index(ordinal) - box_.low[axis];
}

const std::uint32_t* PacketRows::row(std::int64_t sheet_ordinal, std::int64_t row_ordinal) {
  const std::int64_t sheet = local(0, sheet_ordinal), row = local(1, row_ordinal);
  const std::int64_t sample = local(2, ordinals_[2].begin);
  if (sample_stride_ == 1) return box_.packets + sheet * strides_[0] + row * strides_[1] + sample;

  // Pick the visited samples of a contiguous row
  if (plan_.axes[2] == 0) {
    strips_.resize(1);
    if (!strips_[0].lanes) strips_[0].lanes.reset(new std::uint32_t[pitch_]);
    const std::uint32_t* source = box_.packets + sheet * strides_[0] + row * strides_[1] + sample;
    for (std::int64_t n = 0; n < ordinals_[2].count(); ++n) strips_[0].lanes[n] = source[n * sample_stride_];
    return strips_[0].lanes.get();
  }
  return strip_row(sheet, row, plan_.axes[0] == 0 ? row_ordinal - ordinals_[1].begin : 0);
}

const std::uint32_t* PacketRows::strip_row(std::int64_t sheet, std::int64_t row, std::int64_t strip_number) {
  // Where sheets follow i, every row keeps its strip for the next 15 sheets; else one strip serves the next rows
  const bool sheets_along_i = plan_.axes[0] == 0;
  const std::int64_t column = sheets_along_i ? sheet : row;
  const std::int64_t group = column / kStripLanes;
  const std::int64_t lanes = std::min<std::int64_t>(box_.size[0], kStripLanes);
  const std::int64_t first = std::min(group * kStripLanes, box_.size[0] - lanes);
  const std::int64_t tag = sheets_along_i ? group : sheet * box_.size[0] + group;

  if (strips_.empty()) strips_.resize(sheets_along_i ? ordinals_[1].count() : 1);
  Strip& strip = strips_[strip_number];
  if (strip.tag != tag) {
    const std::int64_t other = sheets_along_i ? row * strides_[1] : sheet * strides_[0];
    fill(strip, box_.packets + first + other + local(2, ordinals_[2].begin) * strides_[2], lanes);
    strip.tag = tag;
  }
  return strip.lanes.get() + (column - first) * pitch_;
}

void PacketRows::fill(Strip& strip, const std::uint32_t* source, std::int64_t lanes) const {
  if (!strip.lanes) strip.lanes.reset(new std::uint32_t[kStripLanes * pitch_]);
  const std::int64_t n = ordinals_[2].count();
  if (lanes == kStripLanes) {
    path_kernels().transpose(source, sample_stride_, n, strip.lanes.get(), pitch_);
    return;
  }
  for (std::int64_t at = 0; at < n; ++at) {
    const std::uint32_t* line = source + at * sample_stride_;
    for (std::int64_t lane = 0; lane < lanes; ++lane) strip.lanes[lane * pitch_ + at] = line[lane];
  }
}

}  // namespace volsplat
