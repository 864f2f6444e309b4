// Lists the functions of volsplat.splat_server._kernels; the work lies in the files beside it.
#include <nanobind/nanobind.h>

#include "combining.h"
#include "kernels/bind_cpu_path.h"
#include "merge.h"

NB_MODULE(_kernels, m) {
    m.doc() = "Kernels of the splat_server.";
    // Cached tables live until the interpreter ends; nanobind would report them on the person's terminal.
    nanobind::set_leak_warnings(false);
    volsplat::bind_cpu_path(m);
    volsplat::bind_merge(m);
    volsplat::bind_combining(m);
}
