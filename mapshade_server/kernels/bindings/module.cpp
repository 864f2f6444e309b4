// Lists what volsplat.mapshade_server._kernels offers; the work lies in the folder above.
#include <nanobind/nanobind.h>

#include "frame_walk.h"
#include "kernels/bind_cpu_path.h"
#include "preprocessing.h"

NB_MODULE(_kernels, m) {
  m.doc() = "Kernels of the map/shade server.";
  // Cached tables live until the interpreter ends; nanobind would report them on the person's terminal.
  nanobind::set_leak_warnings(false);
  volsplat::bind_cpu_path(m);
  volsplat::bind_preprocessing(m);
  volsplat::bind_frame_walk(m);
}
