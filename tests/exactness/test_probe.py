"""What is seen at a point of the image: the front-most voxel that a frame would send from there."""

import math
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st
from torch import Tensor

from reference import mapping, shading, voxel_packets
from support.files.head_volume import head, scene, single
from support.scenes.arbitrary import geometries, plain_scene
from support.scenes.shadings import partitions, quantisations, shaded_scenes, volumes
from tolerances import POINT_TIE
from volsplat.client import Session
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.answers.probe import front_most
from volsplat.mapshade_server.frames.shading_tables import opacity_codes
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Quantise, Scene, View
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.messages import ProbedVoxel
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.line_of_sight import MOST_ASIDE, LineOfSight, line_of_sight, sight_plan
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import BadInput, VolsplatError

__all__ = ["head", "scene", "single"]

HALF = 0.5  # of a cell, of a pixel
JITTER = 0.0137  # pixels: keeps points off the middles and edges of cells, where rounding decides


# -- against the reference


@given(data=st.data(), geometry=geometries(), quantisation=quantisations())
def test_a_probe_finds_the_front_most_sample_that_the_reference_sends(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation
) -> None:
    scene, values = data.draw(shaded_scenes(geometry)), data.draw(volumes(geometry))
    aim: Index = (0, 0, 0)
    aim = tuple(data.draw(st.integers(0, size - 1)) for size in geometry.dims)  # type: ignore[assignment]
    at = mapping.on_screen(torch.tensor([aim], dtype=torch.float64), scene, geometry)[0]
    point = at + torch.tensor([data.draw(st.floats(-3, 3)) + JITTER for _ in range(2)], dtype=torch.float64)
    line = line_of_sight(scene, geometry, float(point[0]), float(point[1]))
    plan = sight_plan(scene, geometry)

    expected = expected_voxel(values, geometry, quantisation, scene, plan, line, point)
    cubes = [SubCube.of_volume(geometry, values, box) for box in data.draw(partitions(geometry))]
    for cube in cubes:
        cube.pack(quantisation)
    assert front_most(cubes, Drawing.of(scene, plan, geometry, quantisation), line) == expected


def expected_voxel(
    values: Tensor,
    geometry: Geometry,
    quantisation: Quantisation,
    scene: Scene,
    plan: FramePlan,
    line: LineOfSight,
    point: Tensor,
) -> ProbedVoxel | None:
    """By looking at every sample; `point` is in pixels."""
    packets = voxel_packets.pack(values, geometry, quantisation)
    samples = mapping.samples_of(scene, geometry, plan)
    i, j, k = samples.indices.unbind(1)
    here = packets[k, j, i]
    fields = shading.field_bytes(plan, geometry, quantisation.directions, samples.indices, here)
    vectors = voxel_packets.directions(quantisation.directions)
    exponent = shading.opacity_exponents(plan, samples.indices)
    _, opacity = shading.shade(here, fields, scene, Step.F, exponent, vectors)
    seen = (shading.opacity_codes(opacity) > 0) & under(samples.exact, point, plan, line)
    if not seen.any():
        return None
    first = int(seen.nonzero()[0])
    density, strength = int(here[first]) & 255, int(here[first]) >> 8 & 255
    scale = quantisation.strength_scale
    return ProbedVoxel(
        index=(int(i[first]), int(j[first]), int(k[first])),
        density=quantisation.window[0] + density / quantisation.density_scale,
        strength=strength / scale if scale else 0.0,
    )


def under(positions: Tensor, point: Tensor, plan: FramePlan, line: LineOfSight) -> Tensor:
    """Which samples at these positions (n, 2) lie under the point: bool (n,)."""
    _, row, sample = plan.traversal.axes
    steps = torch.tensor([[steps[axis] for axis in (row, sample)] for steps in (line.across, line.down)]).double()
    pixels = positions - point
    cells = torch.linalg.solve(steps, pixels.T).T
    for distances, edge in ((pixels, HALF), (cells, HALF), (cells, MOST_ASIDE)):
        assume(bool(((distances.abs() - edge).abs() > POINT_TIE).all()))
    in_cell = (cells.abs() <= HALF).all(dim=1)
    in_pixel = (pixels.abs() <= HALF).all(dim=1) & (cells.abs() <= MOST_ASIDE).all(dim=1)
    found: Tensor = in_cell | in_pixel
    return found


def test_whatever_is_looked_through_tables_are_looked_up_a_few_times() -> None:
    """Once for each 16 voxels took a fifth of a second where there were many patches."""
    depth = 2000
    geometry, values = Geometry((1, 1, depth)), torch.zeros((depth, 1, 1))
    values[0] = 1.0  # the hindmost
    cube, quantisation = SubCube.of_volume(geometry, values, geometry.box), Quantisation((0.0, 1.0), 0.0)
    cube.pack(quantisation)
    scene = plain_scene(view=View(zoom=4.0), size=(9, 9))
    drawing = Drawing.of(scene, sight_plan(scene, geometry), geometry, quantisation)
    before = sum(opacity_codes.cache_info()[:2])
    seen = front_most([cube], drawing, line_of_sight(scene, geometry, 4.0, 4.0))
    assert seen is not None and seen.index == (0, 0, 0)
    assert sum(opacity_codes.cache_info()[:2]) - before <= math.log2(depth)


# -- with a session's servers, and in a single process


@pytest.fixture(scope="module")
def session(head: Path) -> Iterator[Session]:
    with Session(head, workers=2) as session:
        yield session


POINTS = [(x - 0.25, float(y)) for y in range(2, 80, 7) for x in range(2, 96, 7)]


def test_before_anything_is_drawn_there_is_something_to_be_seen(head: Path, scene: Scene) -> None:
    with Session(head, workers=1) as session:
        assert session.probe(scene, 48.0, 40.0) is not None


def test_servers_and_a_single_process_see_the_same(session: Session, single: SingleProcess, scene: Scene) -> None:
    seen = [session.probe(scene, x, y) for x, y in POINTS]
    assert seen == [single.probe(scene, x, y) for x, y in POINTS]
    assert any(seen) and not all(seen)


def test_what_is_seen_is_where_the_image_is_not_empty(session: Session, scene: Scene) -> None:
    alpha = session.render(scene)[..., 3]
    for x, y in POINTS:
        if session.probe(scene, x, y) is not None:
            assert alpha[round(y), round(x)] > 0


def test_within_bounds_only_what_they_hold_is_seen(session: Session, single: SingleProcess, scene: Scene) -> None:
    cut = msgspec.structs.replace(scene, bounds=Bounds(low=(8, 10, 9), high=(20, 40, 30)))
    seen = [session.probe(cut, x, y) for x, y in POINTS]
    assert seen == [single.probe(cut, x, y) for x, y in POINTS]
    inside = [voxel.index for voxel in seen if voxel is not None]
    assert inside and all(8 <= i < 20 and 10 <= j < 40 and 9 <= k < 30 for i, j, k in inside)


@pytest.mark.parametrize("point", [(-0.6, 40.0), (95.5, 40.0), (48.0, 79.5), (float("nan"), 1.0), (0.5, float("inf"))])
def test_outside_the_image_nothing_is_seen(session: Session, scene: Scene, point: tuple[float, float]) -> None:
    assert session.probe(scene, *point) is None


def test_another_window_is_packed_for_a_probe_and_the_images_stay_right(
    session: Session, single: SingleProcess, scene: Scene
) -> None:
    other = msgspec.structs.replace(scene, quantise=Quantise(window=(100.0, 900.0)))
    image = session.render(scene)
    seen = session.probe(other, 48.0, 40.0)
    assert seen == single.probe(other, 48.0, 40.0) and seen is not None
    assert torch.equal(session.render(scene), image)


def test_a_probe_leaves_a_frame_that_runs_as_it_is(session: Session, single: SingleProcess, scene: Scene) -> None:
    seen, images = single.probe(scene, 48.0, 40.0), []
    for refinement in session.refine(scene, partial_interval=0.0001):
        assert session.probe(scene, 48.0, 40.0) == seen
        if refinement.complete:
            images.append(refinement.image)
    for image, step in zip(images, PAPER_STEPS, strict=True):
        assert torch.equal(image, single.render(scene, step))


def test_a_probe_that_does_not_fit_is_refused_and_the_session_goes_on(
    session: Session, single: SingleProcess, scene: Scene
) -> None:
    outside = msgspec.structs.replace(scene, bounds=Bounds(low=(0, 99, 0)))
    for probe in (session.probe, single.probe):
        with pytest.raises(BadInput, match="bounds on j"):
            probe(outside, 48.0, 40.0)
    assert session.probe(scene, 48.0, 40.0) is not None


def test_a_closed_session_sees_nothing_more(head: Path, scene: Scene) -> None:
    session = Session(head, workers=1)
    assert session.probe(scene, 48.0, 40.0) is not None
    session.close()
    with pytest.raises(VolsplatError, match="closed"):
        session.probe(scene, 48.0, 40.0)


# -- known values


def test_bytes_are_told_as_they_are_and_the_nearer_voxel_hides_the_other(tmp_path: Path) -> None:
    values = torch.zeros((9, 9, 9), dtype=torch.uint8)
    values[2, 4, 4], values[6, 4, 4] = 77, 200
    path = tmp_path / "two.mha"
    write_volume(path, values, Geometry((9, 9, 9)))
    with SingleProcess(path) as single:
        middle, cell = (9.5, 9.5), 4.0  # pixels
        for turn, front, density in (((0.0, 0.0, 0.0, 1.0), 6, 200.0), ((1.0, 0.0, 0.0, 0.0), 2, 77.0)):
            scene = plain_scene(view=View(rotation=turn, zoom=cell), size=(20, 20))
            seen = single.probe(scene, *middle)
            assert seen is not None and (seen.index, seen.density) == ((4, 4, front), density)
            assert single.probe(scene, middle[0] + 0.49 * cell, middle[1] - 0.49 * cell) == seen
            assert single.probe(scene, middle[0] + 0.51 * cell, middle[1]) is None


def test_strength_is_per_unit_of_length(tmp_path: Path) -> None:
    slope, spacing = 30.0, 0.5  # of one voxel, in mm
    values = (torch.arange(8.0) * slope).expand(8, 8, 8).contiguous()
    path = tmp_path / "ramp.mha"
    write_volume(path, values, Geometry((8, 8, 8), ((spacing, 0.0, 0.0), (0.0, spacing, 0.0), (0.0, 0.0, spacing))))
    with SingleProcess(path) as single:
        scene = plain_scene(view=View(zoom=4.0), size=(32, 32))
        seen = single.probe(scene, 18.0, 18.0)
        low, high = single.volume.automatic_window
        assert seen is not None
        assert seen.strength == pytest.approx(slope / spacing, rel=1 / 255)
        assert seen.density == pytest.approx(slope * seen.index[0], abs=(high - low) / 255)
