#include "cpu_path.h"

#include <atomic>
#include <cstdlib>
#include <stdexcept>

#include "paths/splat_loops.h"
#include "splat.h"

namespace volsplat {
namespace {

struct CpuPath {
    const char* name;
    SplatOutcome (*splat)(const SplatJob&);
    void (*find_run_rows)(const SplatJob&, RowSpan*);
    void (*fill_footprints)(const FootprintBox&, float*);
};

const std::vector<CpuPath>& available() {
    static const std::vector<CpuPath> paths = [] {
        std::vector<CpuPath> found{{"baseline", baseline::splat, baseline::find_run_rows, baseline::fill_footprints}};
#ifdef VOLSPLAT_X86
        __builtin_cpu_init();
        if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2")) {
            found.push_back({"avx2", avx2::splat, avx2::find_run_rows, avx2::fill_footprints});
            if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
                found.push_back({"avx512", avx512::splat, avx512::find_run_rows, avx512::fill_footprints});
        }
#endif
        return found;
    }();
    return paths;
}

const CpuPath* named(const std::string& name) {
    std::string known;
    for (const CpuPath& path : available()) {
        if (name == path.name) return &path;
        known += known.empty() ? path.name : std::string(", ") + path.name;
    }
    throw std::invalid_argument("no CPU path '" + name + "' on this machine; it has " + known);
}

std::atomic<const CpuPath*>& chosen() {
    static std::atomic<const CpuPath*> path = [] {
        const char* forced = std::getenv("VOLSPLAT_CPU_PATH");
        return forced && *forced ? named(forced) : &available().back();
    }();
    return path;
}

}  // namespace

std::vector<std::string> cpu_paths() {
    std::vector<std::string> names;
    for (const CpuPath& path : available()) names.emplace_back(path.name);
    return names;
}

void set_cpu_path(const std::string& name) { chosen() = named(name); }

std::string cpu_path() { return chosen().load()->name; }

SplatOutcome splat(const SplatJob& job) { return chosen().load()->splat(job); }

void find_run_rows(const SplatJob& job, RowSpan* rows) { chosen().load()->find_run_rows(job, rows); }

void fill_footprints(const FootprintBox& box, float* weights) { chosen().load()->fill_footprints(box, weights); }

}  // namespace volsplat
