// Rows of a box's voxel packets along any grid axis, contiguous and with the visited samples only.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "walk_plan.h"

namespace volsplat {

struct PacketBox {
  const std::uint32_t* packets;  // i fastest
  Index3 low;                    // its place in the grid
  Index3 size;
};

// A half-open range of visit ordinals.
struct Ordinals {
  std::int64_t begin, end;
  std::int64_t count() const { return end - begin; }
  bool holds(std::int64_t ordinal) const { return ordinal >= begin && ordinal < end; }
};

class PacketRows {
 public:
  PacketRows(const PacketBox& box, const WalkPlan& plan);

  // The visit ordinals of the box on the axis of sheets (0), rows (1) or samples (2).
  const Ordinals& ordinals(int level) const { return ordinals_[level]; }
  bool empty() const;

  // The packets of all the box's samples of a row, by rising ordinal; valid until the next call.
  const std::uint32_t* row(std::int64_t sheet_ordinal, std::int64_t row_ordinal);

 private:
  // Lines of 16 packets along i that were turned into 16 rows. Which ones is told by their tag.
  struct Strip {
    std::int64_t tag = -1;
    std::unique_ptr<std::uint32_t[]> lanes;
  };

  std::int64_t local(int level, std::int64_t ordinal) const;
  const std::uint32_t* strip_row(std::int64_t sheet, std::int64_t row, std::int64_t strip_number);
  void fill(Strip& strip, const std::uint32_t* source, std::int64_t lanes) const;

  PacketBox box_;
  const WalkPlan& plan_;
  Ordinals ordinals_[3];
  std::int64_t strides_[3];    // in packets, by level
  std::int64_t sample_stride_;  // in packets, from one visited sample to the next
  std::int64_t pitch_;          // of a strip's lanes
  std::vector<Strip> strips_;
};

}  // namespace volsplat
