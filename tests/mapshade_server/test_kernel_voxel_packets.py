"""The preprocessing kernel against the reference: surveys, histograms and voxel packets."""

import gc
import math
import weakref

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.utils.dlpack import from_dlpack

from reference import voxel_packets
from support.scenes.arbitrary import geometries
from support.scenes.shadings import WINDOW, Scheme, directions, partitions, quantisations, volumes
from tolerances import SQUARE_ROOT
from volsplat.bench.floors.cpu_paths import kernels_on
from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.block_extremes import BlockExtremes, block_dims, block_size
from volsplat.protocol.description.volume import HALO, Box, Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, DirectionCode, Quantisation, second_scalar_scale
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT
from volsplat.protocol.text.errors import LocalProtocolError

SCALAR_TYPES = [getattr(torch, sign + bits) for sign in ("int", "uint") for bits in ("8", "16", "32", "64")]
SCALAR_TYPES += [torch.float32, torch.float64]
PLAIN = Quantisation(window=WINDOW, strength_scale=50.0)
DEGREES = (-180.0, 180.0)


def packed(geometry: Geometry, values: Tensor, quantisation: Quantisation, box: Box | None = None) -> Tensor:
    sub_cube = SubCube.of_volume(geometry, values, box)
    sub_cube.pack(quantisation)
    return from_dlpack(sub_cube.packets).to(torch.int64)


@given(data=st.data(), geometry=geometries(largest=20), quantisation=quantisations())
def test_packets_are_those_of_the_reference_on_every_cpu_path(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation
) -> None:
    values = data.draw(volumes(geometry))
    expected = voxel_packets.pack(values, geometry, quantisation)
    for path in _kernels.cpu_paths():
        with kernels_on(_kernels, path):
            assert torch.equal(packed(geometry, values, quantisation), expected), path


@given(data=st.data(), geometry=geometries(), quantisation=quantisations())
def test_packets_do_not_depend_on_the_partition(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation
) -> None:
    values = data.draw(volumes(geometry))
    whole = packed(geometry, values, quantisation)
    for box in data.draw(partitions(geometry)):
        (i0, j0, k0), (i1, j1, k1) = box
        assert torch.equal(packed(geometry, values, quantisation, box), whole[k0:k1, j0:j1, i0:i1])


@given(data=st.data(), geometry=geometries(largest=20))
def test_a_survey_states_extremes_and_missing_voxels(data: st.DataObject, geometry: Geometry) -> None:
    values = data.draw(volumes(geometry))
    there = torch.isfinite(values)
    strengths = voxel_packets.strengths(voxel_packets.gradients(values, geometry))
    for path in _kernels.cpu_paths():
        with kernels_on(_kernels, path):
            survey = SubCube.of_volume(geometry, values).survey()
        assert survey.voxels == values.numel()
        assert survey.no_data == int((~there).sum())
        assert survey.low == torch.where(there, values, torch.inf).min()
        assert survey.high == torch.where(there, values, -torch.inf).max()
        greatest = float(torch.where(there, strengths, 0.0).max())
        assert survey.max_gradient == pytest.approx(greatest, rel=SQUARE_ROOT)


@given(data=st.data(), geometry=geometries())
def test_surveys_and_histograms_of_sub_cubes_add_up_to_the_volumes(data: st.DataObject, geometry: Geometry) -> None:
    values = data.draw(volumes(geometry))
    whole = SubCube.of_volume(geometry, values)
    survey = whole.survey()
    counts = whole.histograms(survey.low, survey.high, survey.max_gradient)
    parts = [SubCube.of_volume(geometry, values, box) for box in data.draw(partitions(geometry))]
    joined = parts[0].survey()
    for part in parts[1:]:
        joined = joined.joined(part.survey())
    assert joined == survey
    added = [part.histograms(survey.low, survey.high, survey.max_gradient) for part in parts]
    assert torch.equal(sum_of([one.density for one in added]), sum_of([counts.density]))
    assert torch.equal(sum_of([one.strength for one in added]), sum_of([counts.strength]))
    extremes = BlockExtremes.nothing(geometry.dims)
    for one in added:
        extremes = extremes.joined(one.extremes)
    assert extremes == counts.extremes


def test_blocks_have_the_extremes_of_their_voxels() -> None:
    dims = (70, 33, 5)
    values = torch.rand(dims[::-1])
    values[0, :, :40] = math.nan
    extremes = SubCube.of_volume(Geometry(dims), values).histograms(0.0, 1.0, 1.0).extremes
    assert block_size(dims) == (3, 2, 1) and block_dims(dims) == (24, 17, 5)
    for n in range(24 * 17 * 5):
        i, j, k = 3 * (n % 24), 2 * (n // 24 % 17), n // (24 * 17)
        block = values[k, j : j + 2, i : i + 3]
        there = block[~block.isnan()].tolist() or [math.inf]
        assert extremes.least[n] == min(there)
        assert extremes.greatest[n] == (max(there) if there != [math.inf] else -math.inf)


def sum_of(counts: list[memoryview]) -> Tensor:
    return torch.stack([torch.frombuffer(count, dtype=torch.int64) for count in counts]).sum(dim=0)


@given(data=st.data(), geometry=geometries(largest=20))
def test_histograms_count_what_torch_counts(data: st.DataObject, geometry: Geometry) -> None:
    values = data.draw(volumes(geometry))
    sub_cube = SubCube.of_volume(geometry, values)
    survey = sub_cube.survey()
    counts = sub_cube.histograms(*WINDOW, survey.max_gradient)
    there = torch.isfinite(values)
    strengths = voxel_packets.strengths(voxel_packets.gradients(values, geometry))
    assert torch.equal(sum_of([counts.density]), counted(values[there], *WINDOW))
    assert torch.equal(sum_of([counts.strength]), counted(strengths[there], 0.0, survey.max_gradient))


@given(data=st.data(), geometry=geometries(largest=20), scheme=directions)
def test_a_second_scalar_takes_the_place_of_strength_on_every_cpu_path(
    data: st.DataObject, geometry: Geometry, scheme: Scheme
) -> None:
    values, second = data.draw(volumes(geometry)), 100.0 * data.draw(volumes(geometry))
    scale = second_scalar_scale(DEGREES)
    quantisation = Quantisation(window=WINDOW, strength_scale=scale, strength_low=DEGREES[0], directions=scheme)
    expected = voxel_packets.pack(values, geometry, quantisation, second)
    there = torch.isfinite(values)
    both = there & torch.isfinite(second)
    for path in _kernels.cpu_paths():
        with kernels_on(_kernels, path):
            sub_cube = with_second(geometry, values, second, geometry.box)
            counts = sub_cube.histograms(*WINDOW, 1.0)
            sub_cube.pack(quantisation)
        assert torch.equal(from_dlpack(sub_cube.packets).to(torch.int64), expected), path
        assert torch.equal(sum_of([counts.density]), counted(values[there], *WINDOW)), path
        assert torch.equal(sum_of([counts.strength]), counted(second[both], *DEGREES)), path


@given(data=st.data(), geometry=geometries())
def test_a_second_scalar_does_not_depend_on_the_partition(data: st.DataObject, geometry: Geometry) -> None:
    values, second = data.draw(volumes(geometry)), 100.0 * data.draw(volumes(geometry))
    quantisation = Quantisation(window=WINDOW, strength_scale=second_scalar_scale(DEGREES), strength_low=DEGREES[0])
    whole = voxel_packets.pack(values, geometry, quantisation, second)
    for box in data.draw(partitions(geometry)):
        (i0, j0, k0), (i1, j1, k1) = box
        sub_cube = with_second(geometry, values, second, box)
        sub_cube.pack(quantisation)
        assert torch.equal(from_dlpack(sub_cube.packets).to(torch.int64), whole[k0:k1, j0:j1, i0:i1])


def with_second(geometry: Geometry, values: Tensor, second: Tensor, box: Box) -> SubCube:
    (i0, j0, k0), (i1, j1, k1) = box
    sub_cube = SubCube(geometry, box, DEGREES)
    low, high = box.grown(HALO, geometry.dims)
    sub_cube.hold(values[low[2] : high[2], low[1] : high[1], low[0] : high[0]], second[k0:k1, j0:j1, i0:i1])
    return sub_cube


def test_a_second_scalar_of_another_shape_is_refused() -> None:
    geometry = Geometry((4, 4, 4))
    sub_cube = SubCube(geometry, Box((0, 0, 0), (2, 4, 4)), DEGREES)
    sub_cube.hold(torch.zeros(4, 4, 3), torch.zeros(4, 4, 3))
    with pytest.raises(ValueError, match="the shape of the box"):
        sub_cube.pack(PLAIN)


@pytest.mark.parametrize(("range_", "second"), [(None, torch.zeros(2, 2, 2)), ((0.0, 1.0), None)])
def test_a_second_scalar_comes_with_its_range(range_: tuple[float, float] | None, second: Tensor | None) -> None:
    geometry = Geometry((2, 2, 2))
    with pytest.raises(LocalProtocolError, match="second scalar"):
        SubCube(geometry, geometry.box, range_).hold(torch.zeros(2, 2, 2), second)


def counted(values: Tensor, low: float, high: float) -> Tensor:
    scale = HISTOGRAM_BINS / (high - low) if high > low else 0.0
    return torch.bincount(((values - low) * scale).clamp(0, HISTOGRAM_BINS - 1).long(), minlength=HISTOGRAM_BINS)


@pytest.mark.parametrize("scalar_type", SCALAR_TYPES, ids=str)
def test_every_scalar_type_gives_the_packets_of_its_values(scalar_type: torch.dtype) -> None:
    geometry = Geometry((19, 4, 5))
    values = (torch.arange(5 * 4 * 19) * 7 % 120).reshape(5, 4, 19)
    quantisation = Quantisation(window=(0.0, 100.0), strength_scale=3.0)
    expected = voxel_packets.pack(values.double(), geometry, quantisation)
    assert torch.equal(packed(geometry, values.to(scalar_type), quantisation), expected)


def test_a_source_may_have_any_strides() -> None:
    geometry = Geometry((5, 6, 7))
    values = torch.randn(5, 6, 7, dtype=torch.float64)
    stored_backwards = values.permute(2, 1, 0)
    assert torch.equal(
        packed(geometry, stored_backwards, PLAIN), packed(geometry, stored_backwards.contiguous(), PLAIN)
    )


def test_a_value_that_no_volume_has_is_refused() -> None:
    with pytest.raises(TypeError, match="integers of 8 to 64 bits"):
        packed(Geometry((2, 2, 2)), torch.zeros(2, 2, 2, dtype=torch.complex64), PLAIN)


def test_missing_voxels_are_no_data_and_their_neighbours_use_one_sided_differences() -> None:
    geometry = Geometry((5, 1, 1))
    values = torch.tensor([[[0.0, 1.0, torch.nan, 5.0, 8.0]]], dtype=torch.float64)
    packets = packed(geometry, values, Quantisation(window=(0.0, 255.0), strength_scale=10.0)).flatten()
    assert packets[2] == 1 << NO_DATA_BIT
    assert (packets >> 8 & 255).tolist() == [10, 10, 0, 30, 30]


def test_a_voxel_between_missing_ones_has_no_gradient() -> None:
    values = torch.tensor([[[torch.inf, 1.0, torch.nan]]], dtype=torch.float64)
    sub_cube = SubCube.of_volume(Geometry((3, 1, 1)), values)
    assert sub_cube.survey().max_gradient == 0.0


def test_a_volume_without_any_data_is_surveyed_as_empty() -> None:
    survey = SubCube.of_volume(Geometry((3, 2, 2)), torch.full((2, 2, 3), torch.nan)).survey()
    assert survey.low > survey.high
    assert survey.no_data == survey.voxels == 12


@pytest.mark.parametrize("scheme", ["octahedral", "paper", "rough"])
def test_direction_codes_stand_for_the_references_directions(scheme: DirectionCode) -> None:
    vectors = from_dlpack(_kernels.direction_vectors(scheme))
    assert torch.equal(vectors, voxel_packets.directions(scheme))


@given(geometry=geometries(), scheme=directions)
def test_gradient_fields_are_those_of_the_reference(geometry: Geometry, scheme: DirectionCode) -> None:
    axes = [matrices.normalised(matrices.column(geometry.index_to_physical, axis)) for axis in range(3)]
    fields = from_dlpack(_kernels.gradient_bytes(scheme, axes))
    assert torch.equal(fields.to(torch.int64), voxel_packets.gradient_field_bytes(scheme, geometry))


def test_packing_lets_the_source_go() -> None:
    sub_cube = SubCube(Geometry((4, 4, 4)), Geometry((4, 4, 4)).box)
    source = torch.zeros(4, 4, 4)
    sub_cube.hold(source)
    alive = weakref.ref(source)
    del source
    sub_cube.pack(PLAIN)
    gc.collect()
    assert alive() is None
    with pytest.raises(LocalProtocolError, match="read it again"):
        sub_cube.survey()


def test_packets_outlive_their_sub_cube() -> None:
    sub_cube = SubCube.of_volume(Geometry((64, 64, 8)), torch.randn(8, 64, 64))
    sub_cube.pack(PLAIN)
    packets = from_dlpack(sub_cube.packets)
    copy = packets.clone()
    del sub_cube
    gc.collect()
    assert torch.equal(packets, copy)


def test_a_source_of_another_shape_than_box_and_halo_is_refused() -> None:
    sub_cube = SubCube(Geometry((8, 8, 8)), Box((2, 2, 2), (4, 4, 4)))
    with pytest.raises(LocalProtocolError, match=r"\(4, 4, 4\)"):
        sub_cube.hold(torch.zeros(2, 2, 2))


def test_packets_are_asked_for_after_packing_only() -> None:
    sub_cube = SubCube.of_volume(Geometry((2, 2, 2)), torch.zeros(2, 2, 2))
    with pytest.raises(LocalProtocolError, match="before it was packed"):
        _ = sub_cube.packets
