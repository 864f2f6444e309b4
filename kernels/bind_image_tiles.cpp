#include "bind_image_tiles.h"

#include <nanobind/ndarray.h>

#include <stdexcept>
#include <utility>

#include "image_tiles.h"
#include "kernels/interpreter_lock.h"
#include "lent_bytes.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

template <class Value>
void bind(nb::module_& m, const char* name) {
    using Tiles = ImageTiles<Value>;
    struct Images {
        Images(int width, int height)
            : tiles(width, height), bytes(static_cast<std::size_t>(width) * height * kChannels * sizeof(float)) {}
        Tiles tiles;
        std::size_t bytes;  // of an image

        std::size_t bit_bytes() const { return (tiles.tiles() + 7) / 8; }
        void check_planes(std::size_t changed_bytes, std::size_t count, std::size_t planes_bytes) const {
            if (changed_bytes != bit_bytes() || planes_bytes != count * Tiles::kTileBytes)
                throw std::invalid_argument("planes must be those of the tiles that have changed");
        }
    };
    nb::class_<Images>(m, name)
        .def(nb::init<int, int>(), "width"_a, "height"_a)
        .def(
            "note",
            [](Images& self, const LentBytes& pixels, const LentRoom& changed) {
                if (pixels.nbytes() != self.bytes || changed.nbytes() != self.bit_bytes())
                    throw std::invalid_argument("image and bits must be those of the size");
                const Unlocked unlocked;
                return self.tiles.note(reinterpret_cast<const float*>(bytes_of(pixels)), changed.data());
            },
            "pixels"_a, "changed"_a)
        .def(
            "planes",
            [](const Images& self, const LentBytes& changed, std::size_t count, const LentRoom& target) {
                self.check_planes(changed.nbytes(), count, target.nbytes());
                const Unlocked unlocked;
                self.tiles.planes(bytes_of(changed), count, target.data());
            },
            "changed"_a, "count"_a, "target"_a)
        .def(
            "take",
            [](Images& self, const LentBytes& changed, std::size_t count, const LentBytes& planes) {
                self.check_planes(changed.nbytes(), count, planes.nbytes());
                const Unlocked unlocked;
                self.tiles.take(bytes_of(changed), count, bytes_of(planes));
            },
            "changed"_a, "count"_a, "planes"_a)
        .def(
            "lay_out",
            [](const Images& self, const LentRoom& pixels) {
                if (pixels.nbytes() != self.bytes) throw std::invalid_argument("the image must have the size");
                const Unlocked unlocked;
                self.tiles.lay_out(reinterpret_cast<float*>(pixels.data()));
            },
            "pixels"_a);
}

}  // namespace

void bind_image_tiles(nb::module_& m) {
    bind<std::uint8_t>(m, "LevelTiles");
    bind<std::uint32_t>(m, "FloatTiles");
}

}  // namespace volsplat
