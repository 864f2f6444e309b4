// Lists the functions of volsplat.splat_server._kernels; the work lies in the files beside it.
#include <nanobind/nanobind.h>

NB_MODULE(_kernels, m) { m.doc() = "Kernels of the splat_server."; }
