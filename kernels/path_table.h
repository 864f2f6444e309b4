// Kernels that exist once for each instruction set, listed in a table for each.
//
// Files under paths/ are compiled for each instruction set, in the namespace that VOLSPLAT_PATH names. They include no
// header with inline functions that all sets share, of the standard library least of all: the linker would keep one
// copy of such a function, and it might be the one that this machine's CPU cannot run. So they share types, numbers,
// and functions that are always inlined.
#pragma once

namespace volsplat {

// A function of a table. There is no empty one, so that a table that lacks a function does not compile.
template <class Function>
class Kernel;

template <class Result, class... Arguments>
class Kernel<Result(Arguments...)> {
public:
    constexpr Kernel(Result (&function)(Arguments...)) : function_(&function) {}
    __attribute__((always_inline)) Result operator()(Arguments... arguments) const { return function_(arguments...); }

private:
    Result (*function_)(Arguments...);
};

template <auto member>
struct MemberOfTable;
template <class Table, class Function, Kernel<Function> Table::* member>
struct MemberOfTable<member> {
    using Type = Function;
};

// What a member of a table points to, to declare the functions by.
template <auto member>
using FunctionOf = typename MemberOfTable<member>::Type;

}  // namespace volsplat

// Something declared for each instruction set.
#define VOLSPLAT_ON_EACH_PATH(declaration) \
    namespace baseline {                   \
    declaration;                           \
    }                                      \
    namespace avx2 {                       \
    declaration;                           \
    }                                      \
    namespace avx512 {                     \
    declaration;                           \
    }

// Pointers to it, by cpu_path_number().
#if defined(VOLSPLAT_X86)
#define VOLSPLAT_OF_EACH_PATH(name) &baseline::name, &avx2::name, &avx512::name
#else
#define VOLSPLAT_OF_EACH_PATH(name) &baseline::name
#endif
