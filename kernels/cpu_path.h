// Chooses, when the process runs, which instruction set's kernels are used: the widest that the CPU has, or the one
// that the environment variable VOLSPLAT_CPU_PATH names.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

namespace volsplat {

// A path was asked for that does not exist or that this CPU cannot run.
struct BadCpuPath : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// The paths that this CPU can run, narrowest first; "baseline" always.
std::vector<std::string> cpu_paths();

// The name of the path in use. Throws BadCpuPath if VOLSPLAT_CPU_PATH names one that cannot be used.
std::string cpu_path();
void set_cpu_path(const std::string& name);

// The place of the path in use among all of them.
int cpu_path_number();

}  // namespace volsplat
