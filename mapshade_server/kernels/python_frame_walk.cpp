// Checks and converts what Python gives, so that the walk itself need not.
#include "python_frame_walk.h"

#include <algorithm>

#include "shading_tables.h"

namespace volsplat {

namespace {

std::vector<float> padded_colours(const Colours& colours) {
  if (colours.size() != kTableEntries) throw nb::value_error("a colour table needs 256 entries");
  std::vector<float> padded;
  for (const auto& colour : colours) {
    for (double channel : colour) padded.push_back(static_cast<float>(channel));
    padded.push_back(0.0f);
  }
  return padded;
}

Dda dda_of(const std::array<std::int64_t, 4>& numbers) {
  return {numbers[0], {numbers[1], numbers[2], numbers[3]}};
}

AxisVisits visits_of(const std::array<std::int64_t, 5>& numbers) {
  return {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]};
}

// A writable view of a batch's bytes that keeps the batch from being reused.
nb::object view_of(const std::shared_ptr<Batch>& batch, void* data, std::size_t bytes) {
  nb::capsule owner(new std::shared_ptr<Batch>(batch),
                    [](void* p) noexcept { delete static_cast<std::shared_ptr<Batch>*>(p); });
  nb::object array = nb::cast(nb::ndarray<nb::array_api, std::uint8_t>(data, {bytes}, owner));
  return nb::steal(PyMemoryView_FromObject(array.ptr()));
}

}  // namespace

PythonFrameWalk::PythonFrameWalk(
    std::vector<std::pair<PacketArray, Index3>> boxes, const std::array<int, 3>& axes,
    const std::array<bool, 3>& ascending, const std::array<std::array<std::int64_t, 5>, 3>& visits,
    const std::array<std::int64_t, 4>& x, const std::array<std::int64_t, 4>& y,
    const std::array<std::array<std::int64_t, 4>, 3>& screen_index, const std::array<std::int64_t, 2>& image,
    const std::array<double, 2>& reach, const std::array<int, 4>& cross_bar, const Colours& emit, const Colours& refl,
    LightArray light, std::vector<OpacityArray> opacity, const std::array<int, 27>& opacity_of_class,
    GradientByteArray gradient_bytes, std::array<std::vector<std::uint8_t>, 3> grid_bytes)
    : boxes_(std::move(boxes)),
      emit_(padded_colours(emit)),
      refl_(padded_colours(refl)),
      light_(std::move(light)),
      opacity_(std::move(opacity)),
      gradient_bytes_(std::move(gradient_bytes)),
      grid_bytes_(std::move(grid_bytes)) {
  WalkPlan plan{axes,
                ascending,
                {visits_of(visits[0]), visits_of(visits[1]), visits_of(visits[2])},
                dda_of(x),
                dda_of(y),
                {dda_of(screen_index[0]), dda_of(screen_index[1]), dda_of(screen_index[2])},
                image[0],
                image[1],
                reach[0],
                reach[1]};

  ShadingTables tables{};
  Field* fields[4] = {&tables.emit, &tables.refl, &tables.opac, &tables.modu};
  for (int table = 0; table < 4; ++table) {
    if (cross_bar[table] < 0 || cross_bar[table] > static_cast<int>(Field::grid_k)) {
      throw nb::value_error("the cross-bar names a field that does not exist");
    }
    *fields[table] = static_cast<Field>(cross_bar[table]);
  }
  tables.colours = {emit_.data(), refl_.data(), light_.data()};
  for (const OpacityArray& codes : opacity_) tables.opacity.push_back(codes.data());
  for (int number : opacity_of_class) {
    if (number < 0 || number >= static_cast<int>(opacity_.size())) {
      throw nb::value_error("a block class names an opacity table that does not exist");
    }
  }
  tables.opacity_of_class = opacity_of_class;
  tables.gradient_bytes = gradient_bytes_.data();
  for (int axis = 0; axis < 3; ++axis) {
    if (static_cast<std::int64_t>(grid_bytes_[axis].size()) < plan.visits[axis].high) {
      throw nb::value_error("the grid's bytes do not cover the bounds");
    }
    tables.grid_bytes[axis] = grid_bytes_[axis].data();
  }

  std::vector<PacketBox> packet_boxes;
  for (const auto& [packets, low] : boxes_) {
    packet_boxes.push_back({packets.data(),
                            low,
                            {static_cast<std::int64_t>(packets.shape(2)), static_cast<std::int64_t>(packets.shape(1)),
                             static_cast<std::int64_t>(packets.shape(0))}});
  }
  walk_ = std::make_unique<FrameWalk>(plan, tables, packet_boxes);
}

nb::tuple PythonFrameWalk::next_batch(std::int64_t max_packets, std::int64_t max_voxels) {
  if (max_packets < 1 || max_voxels < 1) throw nb::value_error("a batch needs room for at least one packet and voxel");
  const std::shared_ptr<Batch> batch = free_batch();
  {
    nb::gil_scoped_release unlocked;
    walk_->next_batch(static_cast<std::size_t>(max_packets), max_voxels, *batch);
  }
  return nb::make_tuple(view_of(batch, batch->runs.data(), batch->runs.size() * sizeof(RowRun)),
                        view_of(batch, batch->packets.data(), batch->packet_count * sizeof(std::uint64_t)),
                        batch->runs.size(), batch->packet_count,
                        nb::make_tuple(batch->reached_sheet, batch->reached_row), batch->last, batch->voxels_visited);
}

std::shared_ptr<Batch> PythonFrameWalk::free_batch() {
  for (const auto& batch : batches_) {
    if (batch.use_count() == 1) return batch;
  }
  batches_.push_back(std::make_shared<Batch>());
  return batches_.back();
}

}  // namespace volsplat
