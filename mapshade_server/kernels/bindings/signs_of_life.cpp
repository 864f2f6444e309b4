#include "signs_of_life.h"

#include <string>
#include <vector>

#include "kernels/interpreter_lock.h"
#include "mapshade_server/kernels/signs_of_life.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

// Python's bytes, as nanobind's casters take std::string for text.
void begin(SignsOfLife* made, int socket, nb::list signs, double seconds) {
    std::vector<std::string> copied;
    for (const nb::handle sign : signs) {
        const auto bytes = nb::cast<nb::bytes>(sign);
        copied.emplace_back(bytes.c_str(), bytes.size());
    }
    new (made) SignsOfLife(socket, std::move(copied), seconds);
}

nb::bytes take_back(SignsOfLife& signs) {
    std::string rest;
    {
        const Unlocked unlocked;
        rest = signs.take_back();
    }
    return nb::bytes(rest.data(), rest.size());
}

}  // namespace

void bind_signs_of_life(nb::module_& m) {
    nb::class_<SignsOfLife>(m, "SignsOfLife")
        .def("__init__", &begin, "socket"_a, "signs"_a, "seconds"_a)
        .def_prop_ro("left", &SignsOfLife::left)
        .def("take_back", &take_back);
}

}  // namespace volsplat
