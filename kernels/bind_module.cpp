#include "kernels/bind_module.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "kernels/constants.h"
#include "kernels/cpu_path.h"

namespace volsplat {

namespace nb = nanobind;
using namespace nb::literals;

namespace {

nb::dict constants() {
    nb::dict numbers;
    for (const auto& [name, value] : kConstants) numbers[name] = value;
    return numbers;
}

}  // namespace

void bind_module(nb::module_& m) {
    // Cached tables live until the interpreter ends; nanobind would report them on the person's terminal.
    nb::set_leak_warnings(false);
    nb::register_exception_translator([](const std::exception_ptr& raised, void*) {
        try {
            std::rethrow_exception(raised);
        } catch (const BadCpuPath& error) {
            PyErr_SetString(nb::module_::import_("volsplat.protocol.text.errors").attr("BadInput").ptr(), error.what());
        }
    });
    m.def("constants", &constants);
    m.def("cpu_paths", &cpu_paths);
    m.def("cpu_path", &cpu_path);
    m.def("set_cpu_path", &set_cpu_path, "name"_a);
}

}  // namespace volsplat
