// Lists the functions of volsplat.mapshade_server._kernels; the work lies in the files beside it.
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "bare_loop.h"
#include "cpu_path.h"
#include "memory.h"
#include "python_frame_walk.h"
#include "python_preprocessing.h"

using namespace nanobind::literals;
using namespace volsplat;

NB_MODULE(_kernels, m) {
  m.doc() = "Kernels of the map/shade server.";
  // Cached tables live until the interpreter ends; nanobind would report them on the person's terminal.
  nanobind::set_leak_warnings(false);

  nb::register_exception_translator([](const std::exception_ptr& raised, void*) {
    try {
      std::rethrow_exception(raised);
    } catch (const BadCpuPath& error) {
      PyErr_SetString(nb::module_::import_("volsplat.protocol.text.errors").attr("BadInput").ptr(), error.what());
    }
  });

  m.def("cpu_paths", &cpu_paths);
  m.def("cpu_path", &cpu_path);
  m.def("set_cpu_path", &set_cpu_path, "name"_a);

  m.def("give_freed_memory_back", &give_freed_memory_back);

  m.def("survey", &python_survey, "source"_a, "low"_a, "size"_a, "matrix"_a);
  m.def("histograms", &python_histograms, "source"_a, "low"_a, "size"_a, "matrix"_a, "second"_a, "density"_a,
        "strength"_a, "begin"_a, "block_size"_a, "block_count"_a);
  m.def("pack", &python_pack, "source"_a, "low"_a, "size"_a, "matrix"_a, "second"_a, "window_low"_a,
        "density_scale"_a, "strength_low"_a, "strength_scale"_a, "octahedral"_a);

  m.def("bare_loop", [](const PacketArray& packets) { return bare_loop(packets.data(), packets.size()); }, "packets"_a);
  m.def("power", [](double base, double exponent) { return path_kernels().power(base, exponent); }, "base"_a,
        "exponent"_a);
  m.def("direction_vectors", &python_direction_vectors, "octahedral"_a);
  m.def("gradient_bytes", &python_gradient_bytes, "octahedral"_a, "axes"_a);
  m.def("light_table", &python_light_table, "octahedral"_a, "light"_a, "half"_a, "diffuse"_a, "specular"_a,
        "two_sided"_a, "specular_power"_a);
  m.def("colour_table", &python_colour_table, "colours"_a);
  m.def("opacity_table", &python_opacity_table, "opac"_a, "modu"_a, "exponent"_a);

  nb::class_<ClassifiedRows>(m, "ClassifiedRows")
      .def(nb::init<const Index3&, double>(), "size"_a, "share"_a)
      .def_prop_ro("bytes", &ClassifiedRows::bytes)
      .def_prop_ro("axes", &ClassifiedRows::axes);

  nb::class_<PythonFrameWalk>(m, "FrameWalk")
      .def(nb::init<std::vector<PythonBox>, const std::array<int, 3>&, const std::array<bool, 3>&,
                    const std::array<std::array<std::int64_t, 5>, 3>&, const std::array<std::int64_t, 4>&,
                    const std::array<std::int64_t, 4>&, const std::array<std::array<std::int64_t, 4>, 3>&,
                    const std::array<std::int64_t, 2>&, const std::array<double, 2>&, const std::array<int, 4>&,
                    ColourArray, ColourArray, LightArray, std::vector<OpacityArray>, const std::array<int, 27>&,
                    const VisibilityArray&, GradientByteArray, std::array<GridByteArray, 3>,
                    std::optional<TileArray>>(),
           "boxes"_a, "axes"_a, "ascending"_a, "visits"_a, "x"_a, "y"_a, "screen_index"_a, "image"_a, "reach"_a,
           "cross_bar"_a, "emit"_a, "refl"_a, "light"_a, "opacity"_a, "opacity_of_class"_a, "visibility"_a,
           "gradient_bytes"_a, "grid_bytes"_a, "closed_tiles"_a.none())
      .def("next_batch", &PythonFrameWalk::next_batch, "max_packets"_a, "max_voxels"_a);
}
