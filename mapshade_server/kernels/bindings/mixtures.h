// What levels stand for, as Python sees it.
#pragma once

#include <nanobind/nanobind.h>

namespace volsplat {

void bind_mixtures(nanobind::module_& m);

}  // namespace volsplat
