#include "kernels/cpu_path.h"

#include <atomic>
#include <cstdlib>

namespace volsplat {

namespace {

constexpr const char* kVariable = "VOLSPLAT_CPU_PATH";
constexpr int kUnknown = -1;

std::vector<std::string> available() {
    std::vector<std::string> paths{"baseline"};
#if defined(VOLSPLAT_X86)
    __builtin_cpu_init();
    const bool has_avx2 =
        __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2") && __builtin_cpu_supports("fma");
    const bool has_avx512 = has_avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                            __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
    if (has_avx2) paths.push_back("avx2");
    if (has_avx512) paths.push_back("avx512");
#endif
    return paths;
}

const std::vector<std::string>& paths() {
    static const std::vector<std::string> found = available();
    return found;
}

int number_of(const std::string& name, const std::string& asked_by) {
    std::string known;
    for (std::size_t number = 0; number < paths().size(); ++number) {
        if (paths()[number] == name) return static_cast<int>(number);
        known += (number == 0 ? "" : ", ") + paths()[number];
    }
    throw BadCpuPath(asked_by + " asks for the CPU path \"" + name + "\", but this machine has " + known +
                     "; name one of these");
}

std::atomic<int> chosen{kUnknown};

}  // namespace

std::vector<std::string> cpu_paths() { return paths(); }

std::string cpu_path() { return paths()[cpu_path_number()]; }

void set_cpu_path(const std::string& name) { chosen = number_of(name, "set_cpu_path"); }

int cpu_path_number() {
    if (const int number = chosen.load(std::memory_order_relaxed); number != kUnknown) return number;
    const char* wanted = std::getenv(kVariable);
    chosen = wanted && *wanted ? number_of(wanted, kVariable) : static_cast<int>(paths().size()) - 1;
    return chosen;
}

}  // namespace volsplat
