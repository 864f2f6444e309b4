// Prints a sum of what the baseline kernels of both servers make of made-up numbers, without Python: the same on every
// machine, so that a processor can be tried that is only emulated (`make aarch64`).
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <vector>

#include "kernels/packet_layout.h"
#include "mapshade_server/kernels/paths/map_shade_kernels.h"
#include "splat_server/kernels/paths/splat_kernels.h"

namespace volsplat::baseline {

extern const MapShadeKernels kMapShadeKernels;
extern const SplatKernels kSplatKernels;

}  // namespace volsplat::baseline

namespace {

using namespace volsplat;

constexpr std::size_t kVoxels = 1000;

class Chance {
public:
    std::uint32_t next() {
        state_ = state_ * 6364136223846793005u + 1442695040888963407u;
        return static_cast<std::uint32_t>(state_ >> 33);
    }
    double unit() { return next() / 2147483648.0; }

private:
    std::uint64_t state_ = 1;
};

template <class Number>
void add(std::uint64_t& sum, const std::vector<Number>& numbers, std::size_t count) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(numbers.data());
    for (std::size_t n = 0; n < count * sizeof(Number); ++n) sum = (sum ^ bytes[n]) * 1099511628211u;
}

template <class Number, class Next>
std::vector<Number> filled(std::size_t count, const Next& next) {
    std::vector<Number> numbers(count);
    for (Number& number : numbers) number = static_cast<Number>(next());
    return numbers;
}

// A row of values through gradients, quantisation, classification, tables and shading: shaded packets and their number.
std::vector<std::uint64_t> shaded_row(std::uint64_t& sum, std::size_t& count) {
    const MapShadeKernels& kernels = baseline::kMapShadeKernels;
    Chance chance;
    const auto unit = [&] { return chance.unit(); };
    const auto centre = filled<double>(kVoxels + 2 * kSpare, unit), before = filled<double>(kVoxels + kSpare, unit);
    const auto after = filled<double>(kVoxels + kSpare, unit);
    std::vector<double> x(kVoxels + kSpare), y = x, z = x, length = x;
    const GradientRow gradient{x.data(), y.data(), z.data(), length.data()};
    const double matrix[9] = {1.1, 0.1, 0.0, -0.2, 0.9, 0.3, 0.0, 0.05, 1.3};
    const double* const row = centre.data() + kSpare;
    kernels.gradient({row, before.data(), after.data(), after.data(), before.data()}, kVoxels, matrix, gradient);
    std::vector<std::uint32_t> packets(kVoxels + kSpare), visible = packets;
    kernels.pack(row, length.data(), gradient, kVoxels, {0.1, 300.0, 0.0, 200.0, true}, packets.data());
    add(sum, packets, kVoxels);

    Visibility visibility;
    for (auto* words : {visibility.density, visibility.strength}) {
        for (int n = 0; n < 8; ++n) words[n] = chance.next() << 1 | (chance.next() & 1);
    }
    std::vector<std::uint16_t> positions(kVoxels + kSpare), codes = positions;
    count = kernels.classify_row(packets.data(), kVoxels, 0, visibility, positions.data(), visible.data());

    std::vector<std::uint16_t> opacity(65536 + kSpare);
    for (std::size_t n = 0; n < 65536; n += 256) {
        const auto thin = filled<double>(256, unit);
        kernels.opacity_codes(thin.data(), 256, 0.5 + chance.unit(), opacity.data() + n);
    }
    kernels.opacity_by_packet(visible.data(), count, opacity.data(), codes.data());
    const auto vectors = filled<double>(3 * kDirectionCodes, [&] { return 1.2 * chance.unit() - 0.6; });
    std::vector<float> light(2 * kDirectionCodes);
    kernels.light({vectors.data(), vectors.data() + kDirectionCodes, vectors.data() + 2 * kDirectionCodes},
                  kDirectionCodes, {{0.6, 0.0, 0.8}, {0.0, 0.6, 0.8}, true, true, false, 12.5}, light.data(),
                  light.data() + kDirectionCodes);
    add(sum, light, light.size());

    const auto colours = filled<float>(2 * 4 * 256, unit);
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(visible.data());
    const SurvivingSamples samples{{positions.data(), visible.data(), count}, codes.data(), {bytes, 4}, {bytes + 1, 4}};
    std::vector<std::uint64_t> shaded(count);
    const RowLine line{std::int64_t{3} << 32, std::int64_t{5} << 32, 500000000, 250000000};
    kernels.shade(samples, {colours.data(), colours.data() + 4 * 256, light.data(), false}, line,
                  {0, count, 3 << kSubpixelBits, 5 << kSubpixelBits, false}, shaded.data());
    add(sum, shaded, count);
    return shaded;
}

// The packets of a row splatted into an image.
void splat_row(std::uint64_t& sum, const std::vector<std::uint64_t>& packets, bool front_to_back) {
    constexpr int kWidth = 150, kHeight = 90, kSide = 8, kBits = 2;
    constexpr std::int64_t kPlane = kWidth + 2 * kMarginPixels;
    std::vector<float> pixels(4 * kPlane * kHeight), opacities(kOpacityCodes);
    std::vector<float> weights((1 << 2 * kBits) * kSide * kSide + 2 * kWeightMargin);
    for (int code = 0; code < kOpacityCodes; ++code) opacities[code] = static_cast<float>(code) / kOpacityCodes;
    Chance chance;
    for (std::size_t n = kWeightMargin; n < weights.size() - kWeightMargin; ++n) {
        weights[n] = static_cast<float>(chance.unit());
    }
    std::vector<RowSpan> spans(kSide, RowSpan{0, kSide});
    std::vector<std::uint64_t> tiles(tile_rows(kHeight) * tile_words(kWidth) + 1);
    std::vector<std::uint64_t> work(tile_rows(kHeight));
    const RowRun run{0, 0, 0, static_cast<std::uint32_t>(packets.size()), 3 << kSubpixelBits, 5 << kSubpixelBits};
    const SpanView span{reinterpret_cast<const unsigned char*>(&run),
                        reinterpret_cast<const unsigned char*>(packets.data()), 1};
    SplatJob job{};
    job.image.pixels = pixels.data() + kMarginPixels;
    job.image.plane = kPlane, job.image.pitch = 4 * kPlane;
    job.image.width = kWidth, job.image.height = kHeight;
    job.image.closed_tiles = tiles.data(), job.image.tile_words = tile_words(kWidth);
    job.row_end = kHeight;
    job.opacities = opacities.data();
    job.spans = &span, job.span_count = 1;
    job.reach = Reach::footprint;
    job.front_to_back = front_to_back;
    job.footprint.weights = weights.data() + kWeightMargin, job.footprint.spans = spans.data();
    job.footprint.start_x = job.footprint.start_y = -kSide / 2 + 1;
    job.footprint.step_x = job.footprint.step_y = 1 << kBits;
    job.footprint.offset_bits = kBits;
    job.footprint.width = job.footprint.height = job.footprint.pitch = kSide;
    job.work = work.data();
    baseline::kSplatKernels.splat(job);
    add(sum, pixels, pixels.size());
    add(sum, work, work.size());
}

// Voxels added to planes, in sums of so many bits, and the densities that come of them: kBlockPlanes for each pixel.
template <class Number, class Splat, class Find>
std::vector<float> slab_densities(std::uint64_t& sum, const Splat& splat, const Find& find_densities) {
    typedef SumLayout<Number> Layout;
    constexpr int kBits = 2, kSlices = 5, kRows = 7, kColumns = 6, kPlanes = 2 * kBlockPlanes;
    constexpr int kLines = kTileLines, kOffsets = 1 << (2 * kBits + kDepthBits);
    Chance chance;
    const auto weights = filled<typename Layout::Weight>(kOffsets * kRows * kColumns * kSlices + 2 * kWeightMargin,
                                                         [&] { return (chance.unit() - 0.1) * Layout::kUnit / 80; });
    std::vector<RowSpan> spans((1 << (kBits + kDepthBits)) * kRows, RowSpan{0, kColumns});
    std::vector<Number> slice_bits(kSlices + 2 * kPlanesAtOnce), sums(kLines * kTileColumns * kPlanes + kPlanesAtOnce);
    std::fill_n(slice_bits.begin() + kPlanesAtOnce, kSlices, ~Number{0});
    SlabTableView table{};
    table.weights = weights.data() + kWeightMargin, table.spans = spans.data();
    table.slice_bits = slice_bits.data() + kPlanesAtOnce;
    table.offset_bits = kBits, table.slices = kSlices, table.rows = kRows, table.columns = kColumns;
    SlabSums planes{};
    planes.sums = sums.data(), planes.pitch = planes.columns = kTileColumns, planes.planes = kPlanes;
    planes.lines = kLines;
    planes.tile_rows = kLines / kTileLines, planes.tiles = 1;
    planes.bias = Layout::kSignedBias, planes.least = static_cast<std::int32_t>(Layout::kUnit / 16);
    const auto some = [&](int end) { return static_cast<int>(chance.unit() * end); };
    const auto voxels = filled<SlabVoxel>(kVoxels, [&] {
        return SlabVoxel{some(kTileColumns - kColumns),
                         some(kLines) - kRows / 2,
                         static_cast<std::uint32_t>(some(1 << 2 * kBits)),
                         static_cast<std::uint8_t>(some(1 << kDepthBits)),
                         static_cast<std::uint8_t>(some(kBlockPlanes)),
                         static_cast<std::uint8_t>(some(256))};
    });
    splat(table, planes, voxels.data(), voxels.size());
    add(sum, sums, sums.size());
    find_densities(planes, sums.data(), kLines * kTileColumns);
    std::vector<float> found(kLines * kTileColumns * kBlockPlanes);
    for (int pixel = 0; pixel < kLines * kTileColumns; ++pixel)
        std::memcpy(&found[pixel * kBlockPlanes], &sums[pixel * kPlanes], kBlockPlanes * sizeof(float));
    add(sum, found, found.size());
    return found;
}

// Pixels of a slab by made-up tables and light.
void colour_slab(std::uint64_t& sum, const std::vector<float>& densities) {
    Chance chance;
    const auto signed_unit = [&] { return 2 * chance.unit() - 1; };
    SlabScene scene{{Field::density, Field::strength, Field::density, Field::gradient_k},
                    {},
                    {},
                    {},
                    {},
                    {0.6, 0.0, 0.8},
                    {0.0, 0.6, 0.8},
                    true,
                    true,
                    false,
                    12.5,
                    0.3,
                    0.4};
    for (int n = 0; n < kTableEntries; ++n) {
        for (double* entry : {scene.emit[n], scene.refl[n]})
            for (int channel = 0; channel < 3; ++channel) entry[channel] = chance.unit();
        scene.modu[n] = chance.unit();
    }
    SlabGrid grid{{}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, 0.7, {}, {64, 64, 64}, {1, 1, 1}};
    for (auto& row : grid.gradient)
        for (double& number : row) number = signed_unit();
    grid.screen_bytes[2][0] = 20, grid.screen_bytes[2][3] = 3;
    const SlabRays rays{{3, 4, 5}, {0.9, 0.1, 0.2}, {0.1, 0.8, 0.1}, {0.2, 0.1, 0.7}, {2, 2, 2}, {30, 20, 9}, 0.5, 1};
    const auto lamp = filled<float>(64, [&] { return chance.unit(); }), sky = lamp;
    const SlabLight light{lamp.data(), sky.data(), {4, 4, 4}, {16, 16, 16}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                          0.5,         0.6};
    std::vector<ColourIntegral> colours(kTableEntries + 1);
    std::vector<double> depths((kTableEntries + 1) * kOpacityLevels);
    for (int n = 0; n < kTableEntries; ++n) {
        colours[n + 1] = colours[n];
        const double depth = 0.05 * chance.unit();
        colours[n + 1].depth += depth, colours[n + 1].place += depth * (n + 0.5);
        for (int channel = 0; channel < 3; ++channel) {
            colours[n + 1].emit[channel] += depth * chance.unit() / 2;
            colours[n + 1].refl[channel] += depth * chance.unit() / 2;
        }
        for (int level = 0; level < kOpacityLevels; ++level)
            depths[(n + 1) * kOpacityLevels + level] = depths[n * kOpacityLevels + level] + depth * level / 255;
    }
    SlabShadingView view{};
    view.scene = &scene, view.grid = &grid, view.rays = &rays, view.light = &light;
    view.depths = reinterpret_cast<const DepthIntegrals*>(depths.data()), view.colours = colours.data();
    SlabSamples samples{};
    samples.count = kTilePixels, samples.slab = 2;
    for (int n = 0; n < kTilePixels; ++n) {
        samples.x[n] = n % kTileColumns, samples.y[n] = n / kTileColumns;
        for (int side = 0; side < 2; ++side) {
            samples.here[side][n] = densities[n * kBlockPlanes + side];
            samples.next[side][n] = densities[n * kBlockPlanes + 6 + side];
            for (int neighbour = 0; neighbour < 4; ++neighbour)
                samples.beside[side][neighbour][n] = densities[n * kBlockPlanes + 2 + 2 * (neighbour % 3) + side % 2];
        }
    }
    baseline::kSplatKernels.find_slab_colours(view, samples);
    for (const auto& found : samples.found) add(sum, std::vector<float>(found, found + 4), 4);
}

}  // namespace

int main() {
    std::uint64_t sum = 14695981039346656037u;
    std::size_t count = 0;
    const auto packets = shaded_row(sum, count);
    std::printf("%zu packets, map/shade %016llx\n", count, static_cast<unsigned long long>(sum));
    for (bool front_to_back : {false, true}) splat_row(sum, packets, front_to_back);
    std::printf("with splats %016llx\n", static_cast<unsigned long long>(sum));
    const SplatKernels& kernels = baseline::kSplatKernels;
    colour_slab(sum, slab_densities<std::uint32_t>(sum, kernels.splat_slabs, kernels.find_slab_densities));
    colour_slab(sum, slab_densities<std::uint64_t>(sum, kernels.splat_wide_slabs, kernels.find_wide_slab_densities));
    std::printf("with slabs %016llx\n", static_cast<unsigned long long>(sum));
    return count > kVoxels / 8 ? 0 : 1;
}
