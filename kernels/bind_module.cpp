#include "kernels/bind_module.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <system_error>

#include "kernels/constants.h"
#include "kernels/cpu_path.h"

namespace volsplat {

namespace nb = nanobind;
using namespace nb::literals;

namespace {

constexpr const char* kNoThread =
    "the system has no thread left to give: raise the limit of processes (ulimit -u, or the container's), or give "
    "fewer --threads";

nb::dict constants() {
    nb::dict numbers;
    for (const auto& [name, value] : kConstants) numbers[name] = value;
    return numbers;
}

// Of volsplat's own exceptions.
void raise(const char* kind, const char* line) {
    PyErr_SetString(nb::module_::import_("volsplat.protocol.text.errors").attr(kind).ptr(), line);
}

}  // namespace

void bind_module(nb::module_& m) {
    // Cached tables live until the interpreter ends; nanobind would report them on the person's terminal.
    nb::set_leak_warnings(false);
    nb::register_exception_translator([](const std::exception_ptr& raised, void*) {
        try {
            std::rethrow_exception(raised);
        } catch (const BadCpuPath& error) {
            raise("BadInput", error.what());
        } catch (const std::system_error& error) {
            if (error.code() != std::errc::resource_unavailable_try_again) throw;
            raise("NoThread", kNoThread);
        }
    });
    m.def("constants", &constants);
    m.def("cpu_paths", &cpu_paths);
    m.def("cpu_path", &cpu_path);
    m.def("set_cpu_path", &set_cpu_path, "name"_a);
}

}  // namespace volsplat
