// Which instruction set the splat loop runs on: the widest that the CPU has, or the one named by the environment
// variable VOLSPLAT_CPU_PATH.
#pragma once
#include <string>
#include <vector>

namespace volsplat {

// Narrowest first; "baseline" always.
std::vector<std::string> cpu_paths();
// Throws std::invalid_argument where this CPU lacks the path, or no such path exists.
void set_cpu_path(const std::string& name);
std::string cpu_path();

}  // namespace volsplat
