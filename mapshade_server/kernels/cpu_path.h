// Chooses, when the process runs, which instruction set's kernels are used. All of them give the same bits.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "paths/path_kernels.h"

namespace volsplat {

// A path was asked for that does not exist or that this CPU cannot run.
struct BadCpuPath : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The paths that this CPU can run, slowest first.
std::vector<std::string> cpu_paths();

// The name of the path in use. Throws BadCpuPath where VOLSPLAT_CPU_PATH names one that cannot be used.
std::string cpu_path();
void set_cpu_path(const std::string& name);

const PathKernels& path_kernels();

}  // namespace volsplat
