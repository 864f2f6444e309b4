#include "kernels/bind_cpu_path.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "kernels/cpu_path.h"

namespace volsplat {

namespace nb = nanobind;
using namespace nb::literals;

void bind_cpu_path(nb::module_& m) {
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
}

}  // namespace volsplat
