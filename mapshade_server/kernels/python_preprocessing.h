// Preprocessing and shading tables as Python sees them; signatures are in _kernels.pyi.
#pragma once

#include <array>
#include <optional>
#include <utility>

#include "python_arrays.h"
#include "shading_tables.h"
#include "source_volume.h"

namespace volsplat {

using Matrix3 = std::array<double, 9>;  // row-major

nb::tuple python_survey(const SourceArray& source, const Index3& low, const Index3& size, const Matrix3& matrix);
nb::tuple python_histograms(const SourceArray& source, const Index3& low, const Index3& size, const Matrix3& matrix,
                            const std::optional<SourceArray>& second, const std::pair<double, double>& density,
                            const std::pair<double, double>& strength, const Index3& begin, const Index3& block_size,
                            const Index3& block_count);
nb::object python_pack(const SourceArray& source, const Index3& low, const Index3& size, const Matrix3& matrix,
                       const std::optional<SourceArray>& second, double window_low, double density_scale,
                       double strength_low, double strength_scale, bool octahedral);
nb::object python_direction_vectors(bool octahedral);
nb::object python_gradient_bytes(bool octahedral, const std::array<Vector3, 3>& axes);
nb::object python_light_table(bool octahedral, const Vector3& light, const Vector3& half, bool diffuse, bool specular,
                              bool two_sided, double specular_power);
nb::object python_colour_table(const std::vector<Vector3>& colours);
nb::object python_opacity_table(const std::vector<double>& opac, const std::vector<double>& modu, double exponent);

}  // namespace volsplat
