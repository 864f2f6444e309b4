// Lists the functions of volsplat.mapshade_server._kernels; the work lies in the files beside it.
#include <nanobind/nanobind.h>

NB_MODULE(_kernels, m) { m.doc() = "Kernels of the mapshade_server."; }
