// Lists what volsplat.bench._kernels offers: the floors under kernels/paths/.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdexcept>

#include "bench/kernels/paths/bare_loops.h"
#include "kernels/bind_module.h"
#include "kernels/interpreter_lock.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

template <class T, nb::ssize_t... kSizes>
using Array = nb::ndarray<T, nb::shape<kSizes...>, nb::c_contig, nb::device::cpu>;  // -1: any size

// Boxes of an image, checked once so that `run` has nothing to do but the loop.
class BareSplat {
public:
    BareSplat(Array<float, -1, -1, 4> image, Array<const std::int32_t, -1, 2> corners,
              Array<const float, -1, -1, 4> weights, Array<const float, 4> sample)
        : image_(image), corners_(corners), weights_(weights), sample_(sample) {
        if (side() % 4 || side() < 4 || side() > 16 || weights.shape(1) != weights.shape(0))
            throw std::invalid_argument("boxes are squares of 4, 8, 12 or 16 pixels");
        for (std::size_t s = 0; s < corners.shape(0); ++s) {
            const std::int64_t x = corners(s, 0), y = corners(s, 1);
            if (x < 0 || y < 0 || x + side() > std::int64_t(image.shape(1)) ||
                y + side() > std::int64_t(image.shape(0)))
                throw std::invalid_argument("a box leaves the image");
        }
    }

    void run() const {
        const Unlocked unlocked;
        bare_loops().splat(image_.data(), static_cast<std::int64_t>(image_.shape(1)), corners_.data(),
                           static_cast<std::int64_t>(corners_.shape(0)), side(), weights_.data(), sample_.data());
    }

private:
    int side() const { return static_cast<int>(weights_.shape(0)); }

    Array<float, -1, -1, 4> image_;
    Array<const std::int32_t, -1, 2> corners_;
    Array<const float, -1, -1, 4> weights_;
    Array<const float, 4> sample_;
};

std::int64_t bare_shade(Array<const std::uint32_t, -1> packets, Array<const std::uint16_t, 65536> opacity,
                        Array<const float, 256, 4> emit, Array<const float, 256, 4> refl,
                        Array<const float, 32768> light, Array<std::uint64_t, -1> shaded) {
    if (shaded.shape(0) < packets.shape(0)) throw std::invalid_argument("no room for all packets, shaded");
    const BareTables tables{opacity.data(), emit.data(), refl.data(), light.data()};
    const Unlocked unlocked;
    return bare_loops().shade(packets.data(), static_cast<std::int64_t>(packets.shape(0)), tables, shaded.data());
}

}  // namespace

}  // namespace volsplat

NB_MODULE(_kernels, m) {
    m.doc() = "Bare loops that the kernels are measured against.";
    volsplat::bind_module(m);
    nb::class_<volsplat::BareSplat>(m, "BareSplat")
        .def(nb::init<volsplat::Array<float, -1, -1, 4>, volsplat::Array<const std::int32_t, -1, 2>,
                      volsplat::Array<const float, -1, -1, 4>, volsplat::Array<const float, 4>>(),
             "image"_a, "corners"_a, "weights"_a, "sample"_a)
        .def("run", &volsplat::BareSplat::run);
    m.def("bare_shade", &volsplat::bare_shade, "packets"_a, "opacity"_a, "emit"_a, "refl"_a, "light"_a, "shaded"_a);
}
