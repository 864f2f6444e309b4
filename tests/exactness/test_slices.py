"""Slices of the volume: the very packets that pictures are drawn from, whoever holds them, in the scene's colours."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference import shading, voxel_packets
from support.files.head_volume import head, scene, single
from support.scenes.arbitrary import geometries
from support.scenes.shadings import partitions, quantisations, shaded_scenes, volumes
from volsplat.client import Session
from volsplat.client.session.single import SingleProcess
from volsplat.client.slices.slice_picture import MISSING, slice_picture
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.mapshade_server.answers.slice_parts import THICKNESS, slice_parts
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.rules.slice_plane import level_plane
from volsplat.protocol.text.errors import BadInput, RemoteProtocolError, VolsplatError

__all__ = ["head", "scene", "single"]

LEVEL = 1 / 255  # rounding, and the steps of opacity codes


@given(data=st.data(), geometry=geometries(), quantisation=quantisations())
def test_a_slice_has_the_packets_and_colours_of_the_reference_from_any_partition(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation
) -> None:
    scene, values = data.draw(shaded_scenes(geometry)), data.draw(volumes(geometry))
    axis = data.draw(st.integers(0, 2))
    index = data.draw(st.integers(0, geometry.dims[axis] - 1))
    plane = level_plane(geometry.dims, (1, 1, 1), axis, index, data.draw(st.integers(1, 16)))
    plan = plan_frame(scene, geometry, Step.F)
    drawing = Drawing.of(scene, plan, geometry, quantisation)
    whole = VolumeSlice.empty(plane, plan.factors, quantisation)
    for box in data.draw(partitions(geometry)):
        cube = SubCube.of_volume(geometry, values, box)
        cube.pack(quantisation)
        for part, samples in slice_parts([cube], drawing, plane):
            assert not whole.held[part.top : part.top + part.height, part.left : part.left + part.width].any()
            whole.take([part], samples)
    assert whole.held.all()

    along = [[index]] * 3
    for side, count in zip(plane.sides, (plane.width, plane.height), strict=True):
        along[side] = [plane.sample_index(n, side) for n in range(count)]
    places = torch.tensor([(i, j, k) for k in along[2] for j in along[1] for i in along[0]])
    i, j, k = places.unbind(1)
    packets = voxel_packets.pack(values, geometry, quantisation)[k, j, i]
    np.testing.assert_array_equal(whole.packets.reshape(-1), packets)
    bytes_of = shading.field_bytes(plan, geometry, quantisation.directions, places, packets)
    vectors = voxel_packets.directions(quantisation.directions)
    thickness = torch.full((len(places),), THICKNESS, dtype=torch.float64)
    _, opacity = shading.shade(packets, bytes_of, scene, Step.F, thickness, vectors)
    told = torch.from_numpy(whole.colours[..., 3].reshape(-1)) / 255
    some = packets >> NO_DATA_BIT == 0
    assert ((told - opacity).abs() <= LEVEL)[some].all()


def test_sessions_and_the_single_process_read_the_same_slices(head: Path, single: SingleProcess, scene: Scene) -> None:
    geometry = single.volume.description.geometry
    with Session(head, workers=3) as session:
        for axis, size in zip("ijk", geometry.dims, strict=True):
            alone = single.read_slice(scene, axis, size // 2)
            shared = session.read_slice(scene, axis, size // 2)
            np.testing.assert_array_equal(alone.packets, shared.packets)
            np.testing.assert_array_equal(alone.colours, shared.colours)
            assert shared.held.all()
        values = session.slice("k", 18)
        assert values.shape == (geometry.dims[1], geometry.dims[0])
        low, high = single.volume.quantisation(scene.quantise).window
        assert low <= float(values.min()) < float(values.max()) <= high
        voxel = alone.voxel((3, 4, geometry.dims[2] // 2))
        assert voxel is not None and voxel.index == (3, 4, geometry.dims[2] // 2)
        small = session.read_slice(scene, "k", 18, longest=10)
        assert max(small.plane.width, small.plane.height) == 10
        with pytest.raises(BadInput, match="no slice 99 across axis"):
            session.read_slice(scene, "j", 99)
        with pytest.raises(BadInput, match="axis must be one of i, j, k"):
            session.slice("x", 0)
    with pytest.raises(VolsplatError, match="closed"):
        session.slice("k", 0)


def test_a_slice_s_values_are_those_that_were_drawn_with_last_and_nothing_is_packed_for_it(
    head: Path, scene: Scene
) -> None:
    said: list[str] = []

    def packings() -> int:
        return sum("packets" in line for line in said)

    with Session(head, workers=2, threads=3, on_progress=said.append) as session:
        whole = session.slice("k", 18)
        low, high = float(whole.quantile(0.3)), float(whole.quantile(0.9))
        session.render(narrow := scene.with_(window=(low, high)))
        packed = packings()
        inside = session.slice("k", 18)
        assert float(inside.min()) == pytest.approx(low) and float(inside.max()) == pytest.approx(high)
        session.render(narrow)
        assert packings() == packed > 0
        assert session.read_slice(scene, "k", 18).tensor.equal(whole)  # of a scene that is given, in its window


def test_colours_are_those_of_the_tables_over_grey(single: SingleProcess, scene: Scene) -> None:
    replace = msgspec.structs.replace
    clear = replace(scene, tables=replace(scene.tables, opac=ScalarTable(points=((0.0, 0.0),))))
    of_skin, of_nothing = (single.read_slice(s, "k", 18) for s in (scene, clear))
    np.testing.assert_array_equal(of_skin.packets, of_nothing.packets)
    assert of_skin.colours[..., 3].max() > 0 and of_nothing.colours[..., 3].max() == 0
    grey = slice_picture(of_skin, coloured=False)
    np.testing.assert_array_equal(slice_picture(of_nothing, coloured=True), grey)
    assert not np.array_equal(slice_picture(of_skin, coloured=True), grey)


def test_what_no_server_holds_is_shown_as_missing_and_has_no_value(single: SingleProcess, scene: Scene) -> None:
    whole = single.read_slice(scene, "k", 18)
    part = VolumeSlice.empty(whole.plane, whole.factors, whole.quantisation)
    left = Rectangle(0, 0, 10, whole.plane.height)
    samples = whole.packets[:, :10].tobytes() + whole.colours[:, :10].tobytes()
    part.take([left], samples)
    picture = slice_picture(part, coloured=True)
    np.testing.assert_array_equal(picture[:, :10], slice_picture(whole, coloured=True)[:, :10])
    assert (picture[:, 10:, :3] == MISSING).all(axis=2).any() and np.isnan(part.densities[:, 10:]).all()
    assert part.voxel((12, 5, 18)) is None
    with pytest.raises(VolsplatError, match="lost"):
        _ = part.tensor
    with pytest.raises(RemoteProtocolError, match="sent"):
        part.take([Rectangle(30, 0, 10, whole.plane.height)], samples)
