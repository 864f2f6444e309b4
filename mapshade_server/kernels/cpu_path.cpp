// Finds what the CPU can run, and remembers which path was chosen.
#include "cpu_path.h"

#include <atomic>
#include <cstdlib>

namespace volsplat {

namespace baseline { extern const PathKernels kKernels; }
#if defined(VOLSPLAT_X86)
namespace avx2 { extern const PathKernels kKernels; }
namespace avx512 { extern const PathKernels kKernels; }
#endif

namespace {

constexpr const char* kVariable = "VOLSPLAT_CPU_PATH";

struct Path {
  const char* name;
  const PathKernels* kernels;
};

std::vector<Path> available() {
  std::vector<Path> paths{{"baseline", &baseline::kKernels}};
#if defined(VOLSPLAT_X86)
  __builtin_cpu_init();
  const bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2");
  const bool has_avx512 = has_avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                          __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
  if (has_avx2) paths.push_back({"avx2", &avx2::kKernels});
  if (has_avx512) paths.push_back({"avx512", &avx512::kKernels});
#endif
  return paths;
}

const std::vector<Path>& paths() {
  static const std::vector<Path> found = available();
  return found;
}

const Path& path_named(const std::string& name, const std::string& asked_by) {
  std::string known;
  for (const Path& path : paths()) {
    if (path.name == name) return path;
    known += known.empty() ? path.name : std::string(", ") + path.name;
  }
  throw BadCpuPath(asked_by + " asks for the CPU path \"" + name + "\", but this machine has " + known +
                   "; name one of these");
}

std::atomic<const Path*> chosen{nullptr};

const Path& current() {
  if (const Path* path = chosen.load(std::memory_order_acquire)) return *path;
  const char* wanted = std::getenv(kVariable);
  const Path& path = wanted && *wanted ? path_named(wanted, kVariable) : paths().back();
  chosen.store(&path, std::memory_order_release);
  return path;
}

}  // namespace

std::vector<std::string> cpu_paths() {
  std::vector<std::string> names;
  for (const Path& path : paths()) names.emplace_back(path.name);
  return names;
}

std::string cpu_path() { return current().name; }

void set_cpu_path(const std::string& name) {
  chosen.store(&path_named(name, "set_cpu_path"), std::memory_order_release);
}

const PathKernels& path_kernels() { return *current().kernels; }

}  // namespace volsplat
