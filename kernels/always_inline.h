// Functions that files of several instruction sets share: the linker must not keep one copy for all (path_table.h).
#pragma once

#define VOLSPLAT_INLINE __attribute__((always_inline)) inline
