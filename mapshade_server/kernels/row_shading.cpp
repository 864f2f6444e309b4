// Two passes over a row: keep what can be seen, then look up what colours it.
#include "row_shading.h"

#include <algorithm>

#include "cpu_path.h"
#include "shading_tables.h"

namespace volsplat {

namespace {

bool in_packet_scalars(Field field) { return field == Field::density || field == Field::strength; }

int shift_of(Field field) { return field == Field::strength ? 8 : 0; }

int axis_after(Field field, Field first) { return static_cast<int>(field) - static_cast<int>(first); }

}  // namespace

RowShading::RowShading(const WalkPlan& plan, const ShadingTables& tables, std::size_t longest_row)
    : plan_(plan),
      tables_(tables),
      opacity_by_packet_(in_packet_scalars(tables.opac) && in_packet_scalars(tables.modu)),
      opacities_(tables.opacity.size()),
      positions_(longest_row + kSpare),
      packets_(longest_row + kSpare),
      codes_(longest_row + kSpare),
      emit_(longest_row + kSpare),
      refl_(longest_row + kSpare),
      opac_(longest_row + kSpare),
      modu_(longest_row + kSpare) {}

std::size_t RowShading::select(const SampleRow& row, const std::uint32_t* packets, std::size_t n) {
  // Keep what can be seen at all
  const Opacity& table = opacity(row.opacity);
  std::size_t kept = path_kernels().compact(packets, n, table.visible.data(), positions_.data(), packets_.data());
  if (kept == 0) return 0;

  // Look up opacities; fields other than the packet's own may still make a sample transparent
  if (opacity_by_packet_) {
    for (std::size_t s = 0; s < kept; ++s) codes_[s] = table.by_packet[packets_[s] & 0xFFFF];
  } else {
    kept = drop_transparent(row, kept);
  }
  fill_field(tables_.emit, row, kept, emit_.data());
  fill_field(tables_.refl, row, kept, refl_.data());
  return kept;
}

SurvivingSamples RowShading::survivors() const {
  return {positions_.data(), packets_.data(), codes_.data(), emit_.data(), refl_.data()};
}

std::size_t RowShading::drop_transparent(const SampleRow& row, std::size_t n) {
  fill_field(tables_.opac, row, n, opac_.data());
  fill_field(tables_.modu, row, n, modu_.data());
  const std::uint16_t* codes = tables_.opacity[row.opacity];
  std::size_t kept = 0;
  for (std::size_t s = 0; s < n; ++s) {
    const std::uint16_t code = codes[opac_[s] | modu_[s] << 8];
    positions_[kept] = positions_[s];
    packets_[kept] = packets_[s];
    codes_[kept] = code;
    kept += code != 0;
  }
  return kept;
}

void RowShading::fill_field(Field field, const SampleRow& row, std::size_t n, std::uint8_t* out) const {
  switch (field) {
    case Field::density:
    case Field::strength: {
      const int shift = shift_of(field);
      for (std::size_t s = 0; s < n; ++s) out[s] = static_cast<std::uint8_t>(packets_[s] >> shift);
      return;
    }
    case Field::gradient_i:
    case Field::gradient_j:
    case Field::gradient_k: {
      const std::uint8_t* bytes = tables_.gradient_bytes + axis_after(field, Field::gradient_i) * kDirectionCodes;
      for (std::size_t s = 0; s < n; ++s) out[s] = bytes[packets_[s] >> 16 & 0x7FFF];
      return;
    }
    case Field::screen_x:
    case Field::screen_y:
    case Field::screen_z: {
      const Dda& dda = plan_.screen_index[axis_after(field, Field::screen_x)];
      const std::int64_t start = dda.at(row.doubled);
      const std::int64_t step = 2 * plan_.visits_of(2).stride * dda.half_steps[plan_.axes[2]];
      for (std::size_t s = 0; s < n; ++s) {
        out[s] = static_cast<std::uint8_t>(std::clamp<std::int64_t>((start + positions_[s] * step) >> 32, 0, 255));
      }
      return;
    }
    case Field::grid_i:
    case Field::grid_j:
    case Field::grid_k: {
      const int axis = axis_after(field, Field::grid_i);
      const AxisVisits& visits = plan_.visits[axis];
      const std::uint8_t* bytes = tables_.grid_bytes[axis] + visits.index(row.ordinals[axis]);
      const std::int64_t step = axis == plan_.axes[2] ? visits.stride : 0;
      for (std::size_t s = 0; s < n; ++s) out[s] = bytes[positions_[s] * step];
      return;
    }
  }
}

const RowShading::Opacity& RowShading::opacity(int number) {
  Opacity& made = opacities_[number];
  if (made.visible.empty()) {
    const std::uint16_t* codes = tables_.opacity[number];
    if (opacity_by_packet_) {
      const int opac = shift_of(tables_.opac), modu = shift_of(tables_.modu);
      made.by_packet.resize(65536);
      for (int key = 0; key < 65536; ++key) made.by_packet[key] = codes[(key >> opac & 255) | (key >> modu & 255) << 8];
    }
    made.visible = visibility(codes);
  }
  return made;
}

std::vector<std::uint32_t> RowShading::visibility(const std::uint16_t* codes) const {
  // Which entries of opac can be seen with any modu, which of modu with any opac, and whether any can with any
  bool any_modu[256] = {}, any_opac[256] = {}, any = false;
  for (int key = 0; key < 65536; ++key) {
    const bool seen = codes[key] != 0;
    any_modu[key & 255] |= seen;
    any_opac[key >> 8] |= seen;
    any |= seen;
  }
  const bool opac = in_packet_scalars(tables_.opac), modu = in_packet_scalars(tables_.modu);
  std::vector<std::uint32_t> visible(65536 / 32);
  for (int key = 0; key < 65536; ++key) {
    const int o = key >> shift_of(tables_.opac) & 255, m = key >> shift_of(tables_.modu) & 255;
    const bool seen = opac && modu ? codes[o | m << 8] != 0 : opac ? any_modu[o] : modu ? any_opac[m] : any;
    if (seen) visible[key >> 5] |= 1u << (key & 31);
  }
  return visible;
}

}  // namespace volsplat
