#include "splat_server/kernels/regions/owners.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>

#include "kernels/interpreter_lock.h"
#include "kernels/lent_bytes.h"
#include "let_go.h"
#include "owners.h"
#include "slabs.h"
#include "splat_server/kernels/footprint_table.h"
#include "splat_server/kernels/regions/batch_parts.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace volsplat {

namespace {

typedef std::pair<std::uint64_t, std::uint64_t> Counts;  // of runs and packets

// Bytes that a batch costs beside its own, at most: objects, and the rounding of its buffer.
constexpr std::int64_t kBatchOverhead = 8 << 10;

// A batch, pinned for as long as the object lives or its parts are to be splatted.
struct PythonBatch {
    std::shared_ptr<const void> memory;
    std::vector<PartView> parts;
};

PythonBatch batch_of(LentBytes payload, const std::vector<Counts>& counts, std::shared_ptr<ReadBudget> budget) {
    LetGo::now();
    const std::size_t bytes = payload.size() * payload.itemsize();
    std::vector<PartCounts> parts;
    for (const auto& [runs, packets] : counts) parts.push_back({runs, packets});
    PythonBatch batch;
    if (const std::size_t left = bytes - lay_out(parts, bytes_of(payload), bytes, batch.parts); left)
        throw std::invalid_argument(std::to_string(left) + " bytes of a batch belong to no part");
    batch.memory = std::make_shared<HeldMemory>(LetGo::later(std::move(payload)), std::move(budget),
                                                static_cast<std::int64_t>(bytes) + kBatchOverhead);
    return batch;
}

void push(SplatFrame& frame, int source, const PythonBatch& batch, std::uint64_t reached_sheet,
          std::uint64_t reached_row, bool last) {
    frame.push(source, batch.parts, reached_sheet, reached_row, last, batch.memory);
}

// As protocol.packet_layout.opacity_of_code.
const float* opacities() {
    static const std::array<float, kOpacityMask + 1> table = [] {
        std::array<float, kOpacityMask + 1> values;
        for (int code = 0; code <= kOpacityMask; ++code) {
            const int exponent = code >> 8, mantissa = code & 255;
            const double units = exponent == 0 ? mantissa : std::ldexp(256 + mantissa, exponent - 1);
            values[code] = static_cast<float>(units / kOpacityUnit);
        }
        return values;
    }();
    return table.data();
}

SplatJob job_of(const nb::object& reach, bool front_to_back, float frozen_alpha,
                const std::array<std::uint64_t, 2>& thresholds) {
    SplatJob job{};
    job.opacities = opacities();
    job.front_to_back = front_to_back;
    job.frozen_alpha = frozen_alpha;
    job.thresholds = {thresholds[0], thresholds[1]};
    job.reach = Reach::pixel;
    if (nb::isinstance<FootprintTable>(reach)) {
        job.reach = Reach::footprint;
        job.footprint = nb::cast<const FootprintTable&>(reach).view();
    } else if (nb::isinstance<CellView>(reach)) {
        job.reach = Reach::cell;
        job.cell = nb::cast<const CellView&>(reach);
    } else if (nb::isinstance<PythonSlabs>(reach)) {
        job.reach = Reach::slabs;
        job.slabs = &nb::cast<const PythonSlabs&>(reach).frame;
    }
    return job;
}

BatchSource* source_of(const nb::object& walk) {
    const nb::object capsule = walk.attr("source");
    void* const source = PyCapsule_GetPointer(capsule.ptr(), kBatchSourceCapsule);
    if (!source) throw nb::python_error();
    return static_cast<BatchSource*>(source);
}

float* floats_of(const LentRoom& bytes) { return reinterpret_cast<float*>(bytes.data()); }

PixelMemory memory_of(LentRoom bytes) {
    float* const floats = floats_of(bytes);
    const std::size_t count = bytes.size() / sizeof(float);
    return {std::shared_ptr<float[]>(LetGo::later(std::move(bytes)), floats), count};
}

std::shared_ptr<SplatFrame> begin(Owners& owners, const std::vector<std::pair<int, int>>& regions, nb::object reach,
                                  bool front_to_back, float frozen_alpha,
                                  const std::array<std::uint64_t, 2>& thresholds,
                                  const std::array<std::uint64_t, 3>& counts, int sources, bool traced,
                                  std::uint64_t portion, std::optional<std::pair<nb::object, nb::object>> edges,
                                  std::vector<nb::object> walks, std::optional<LentRoom> block,
                                  std::shared_ptr<Bell> news, std::shared_ptr<Bell> all_wait) {
    FrameTask task{{},
                   job_of(reach, front_to_back, frozen_alpha, thresholds),
                   {nullptr, nullptr},
                   {counts[0], counts[1], counts[2]},
                   sources,
                   {},
                   traced,
                   portion,
                   nullptr};
    for (const auto& [first, end] : regions) task.regions.push_back({first, end});
    for (const nb::object& walk : walks) task.walks.push_back(source_of(walk));
    if (edges) task.layers = {&nb::cast<const EdgeLayer&>(edges->first), &nb::cast<const EdgeLayer&>(edges->second)};
    task.keeps = LetGo::later(std::make_tuple(std::move(reach), std::move(edges), std::move(walks)));
    PixelMemory published = block ? memory_of(std::move(*block)) : PixelMemory{};
    const Unlocked unlocked;
    return owners.begin(std::move(task), std::move(published), std::move(news), std::move(all_wait));
}

// A view of memory that `owner` keeps.
nb::object writable_view(nb::object array) { return nb::steal(PyMemoryView_FromObject(array.ptr())); }

// Which keeps what the number lies in.
template <class Number, class Kept>
nb::object view_of(Number* numbers, std::initializer_list<std::size_t> shape, std::shared_ptr<Kept> kept) {
    nb::capsule owner(new std::shared_ptr<Kept>(std::move(kept)),
                      [](void* p) noexcept { delete static_cast<std::shared_ptr<Kept>*>(p); });
    return writable_view(nb::cast(nb::ndarray<nb::array_api, Number>(numbers, shape, owner)));
}

nb::object block_view(const std::shared_ptr<float[]>& block, const Rectangle& rectangle) {
    return view_of(reinterpret_cast<std::uint8_t*>(block.get()), {rectangle.floats() * sizeof(float)}, block);
}

nb::object published(Owners& owners, SplatFrame& frame) {
    LetGo::now();
    const Rectangle& rectangle = frame.block().rectangle;
    if (frame.complete()) return block_view(frame.pixels(), rectangle);
    const std::shared_ptr<float[]> block = owners.free_block(rectangle);
    {
        const Unlocked unlocked;
        frame.show({block.get(), rectangle});
    }
    return block_view(block, rectangle);
}

void show(SplatFrame& frame, const LentRoom& target) {
    const Rectangle& rectangle = frame.block().rectangle;
    if (target.size() != rectangle.floats() * sizeof(float))
        throw std::invalid_argument("the memory to show in has another size than the regions");
    const Unlocked unlocked;
    frame.show({floats_of(target), rectangle});
}

std::tuple<int, int> image_size(const Owners& owners) {
    const std::shared_ptr<ImageMemory>& image = owners.image();
    return image ? std::tuple(image->width(), image->height()) : std::tuple(0, 0);
}

nb::object closed_tiles(Owners& owners) {
    const std::shared_ptr<ImageMemory> image = owners.image();
    if (!image) throw std::invalid_argument("there is no image");
    return view_of(image->closed_tiles(),
                   {static_cast<std::size_t>(image->tile_rows()), static_cast<std::size_t>(image->tile_words())},
                   image);
}

void close(Owners& owners) {
    {
        const Unlocked unlocked;
        owners.close();
    }
    LetGo::now();
}

bool complete(const SplatFrame& frame) {
    LetGo::now();
    return frame.complete();
}

std::vector<OwnerSeconds> seconds(const SplatFrame& frame) {
    std::vector<OwnerSeconds> all;
    for (const OwnerRecord& record : frame.records()) all.push_back(record.seconds);
    return all;
}

// By how many seconds they lie back: Python's clock may count from another moment.
std::vector<std::vector<std::tuple<const char*, double, double>>> spans_of_owners(const SplatFrame& frame) {
    const Clock::time_point now = Clock::now();
    const auto ago = [&](Clock::time_point then) { return std::chrono::duration<double>(now - then).count(); };
    std::vector<std::vector<std::tuple<const char*, double, double>>> all;
    for (const OwnerRecord& record : frame.records()) {
        auto& owners = all.emplace_back();
        for (const OwnerSpan& span : record.spans) owners.push_back({span.stage, ago(span.began), ago(span.ended)});
    }
    return all;
}

std::tuple<std::uint32_t, std::uint32_t> reached(SplatFrame& frame) {
    const Place place = frame.reached();
    return {place.sheet, place.row};
}

std::tuple<int, int, int, int> rectangle(const SplatFrame& frame) {
    const Rectangle& rectangle = frame.block().rectangle;
    return {rectangle.left, rectangle.top, rectangle.width(), rectangle.height()};
}

}  // namespace

void bind_owners(nb::module_& m) {
    typedef nb::call_guard<Unlocked> WithoutLock;
    nb::class_<Bell>(m, "Bell")
        .def(nb::init<>())
        .def("ring", &Bell::ring)
        .def_prop_ro("rung", &Bell::rung)
        .def("wait", nb::overload_cast<std::uint64_t, double>(&Bell::wait), "heard"_a, "seconds"_a, WithoutLock());
    nb::class_<ReadBudget>(m, "ReadBudget")
        .def(
            "__init__",
            [](ReadBudget* self, std::int64_t bytes, std::shared_ptr<Bell> opened) {
                new (self) ReadBudget(bytes, [opened = std::move(opened)] { opened->ring(); });
            },
            "bytes"_a, "opened"_a)
        .def_prop_ro("open", &ReadBudget::open)
        .def_prop_ro("held", &ReadBudget::held);
    nb::class_<PythonBatch>(m, "BatchMemory")
        .def(
            "__init__",
            [](PythonBatch* self, LentBytes payload, const std::vector<Counts>& parts,
               std::shared_ptr<ReadBudget> budget) {
                new (self) PythonBatch(batch_of(std::move(payload), parts, std::move(budget)));
            },
            "payload"_a, "parts"_a, "budget"_a);
    nb::class_<SlabSeconds>(m, "SlabSeconds")
        .def_ro("adding", &SlabSeconds::adding)
        .def_ro("densities", &SlabSeconds::densities)
        .def_ro("shading", &SlabSeconds::shading)
        .def_ro("compositing", &SlabSeconds::compositing);
    nb::class_<OwnerSeconds>(m, "OwnerSeconds")
        .def_ro("merge", &OwnerSeconds::merge)
        .def_ro("splat", &OwnerSeconds::splat)
        .def_ro("slabs", &OwnerSeconds::slabs)
        .def_ro("walk", &OwnerSeconds::walk);
    nb::class_<Walked>(m, "Walked")
        .def_ro("steps", &Walked::steps)
        .def_ro("voxels", &Walked::voxels)
        .def_ro("packets", &Walked::packets)
        .def_ro("bytes", &Walked::bytes);
    nb::class_<SplatFrame>(m, "SplatFrame")
        .def("push", &push, "source"_a, "batch"_a, "reached_sheet"_a, "reached_row"_a, "last"_a, WithoutLock())
        .def("finish", &SplatFrame::finish, "source"_a)
        .def("finished", &SplatFrame::finished, "source"_a)
        .def_prop_ro("complete", &complete)
        .def_prop_ro("awaited", &SplatFrame::awaited)
        .def_prop_ro("packets", &SplatFrame::packets)
        .def_prop_ro("hidden_packets", &SplatFrame::hidden_packets)
        .def("reached", &reached)
        .def_prop_ro("rectangle", &rectangle)
        .def("show", &show, "target"_a)
        .def_prop_ro("work", &SplatFrame::work)
        .def_prop_ro("seconds", &seconds)
        .def_prop_ro("spans", &spans_of_owners)
        .def_prop_ro("walked", &SplatFrame::walked);
    nb::class_<Owners>(m, "Owners")
        .def(nb::init<int>(), "threads"_a)
        .def("clear", &Owners::clear, "width"_a, "height"_a, "turned"_a, WithoutLock())
        .def_prop_ro("threads", &Owners::threads)
        .def_prop_ro("image_size", &image_size)
        .def_prop_ro("closed_tiles", &closed_tiles)
        .def("begin", &begin, nb::kw_only(), "regions"_a, "reach"_a.none(), "front_to_back"_a,
             "frozen_alpha"_a = static_cast<float>(kFrozenAlpha), "thresholds"_a, "counts"_a, "sources"_a,
             "traced"_a = false, "portion"_a, "edges"_a.none(), "walks"_a, "block"_a.none() = nb::none(), "news"_a,
             "all_wait"_a)
        .def("published", &published, "frame"_a)
        .def("cancel", &Owners::cancel, WithoutLock())
        .def("close", &close);
}

}  // namespace volsplat
