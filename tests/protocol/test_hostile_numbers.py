"""Well-typed messages with any numbers in them are refused as bad input, or done: none is an internal error."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from support.messages.message_samples import SAMPLES
from support.scenes.arbitrary import plain_scene
from support.scenes.owned import owners, wait_until_complete
from support.scenes.phantoms import QUANTISATION
from support.thoroughness import examples
from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.mapshade_server.answers.probe import front_most
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.volume import SCALAR_BYTES, Box, Geometry, VolumeDescription
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.messages import Message
from volsplat.protocol.messages.refusals import OUT_OF_MEMORY, refusal
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation, Survey, strength_scale
from volsplat.protocol.rules.levels import Resolution, factors_of, own_resolution
from volsplat.protocol.rules.light_blocks import LightBlocks
from volsplat.protocol.rules.line_of_sight import line_of_sight, sight_plan
from volsplat.protocol.rules.shading_rule import shading_rule
from volsplat.protocol.text.errors import BadInput
from volsplat.splat_server._kernels import Bell, Owners
from volsplat.splat_server.frame_assembly import FrameAssembly
from volsplat.splat_server.slabs import slabs_of

GEOMETRY = Geometry((6, 5, 4), ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 2.0)))
HALVES = [Box((0, 0, 0), (6, 5, 2)), Box((0, 0, 2), (6, 5, 4))]
WHOLES = (-(2**63), -1, 0, 1, 2, 5, 2**31 - 1, 2**31, 2**32, 2**40, 2**62, 2**63 - 1, 2**64 - 1)
FLOATS = (
    *(0.0, -0.0, -1.0, 0.3, 5e-324, 1e-310, 1e-170, 1e-155, 1e-60, 1e60, 1e155, 1e170, 1.7e308, -1.7e308),
    *(float("nan"), float("inf"), float("-inf")),
)
MOST_CHANGES = 5
Place = tuple[Any, ...]
Spoilable = TypeVar("Spoilable", bound=msgspec.Struct)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("hostile") / "small.nrrd"
    write_volume(path, torch.arange(120, dtype=torch.int16).reshape(4, 5, 6), GEOMETRY)
    return path


def numbers_in(value: Any, at: Place = ()) -> Iterator[tuple[Place, float]]:
    """Where the numbers are in builtins, and which."""
    match value:
        case bool():
            pass
        case int() | float():
            yield at, value
        case dict():
            for key, part in value.items():
                yield from numbers_in(part, (*at, key))
        case list() | tuple():
            for n, part in enumerate(value):
                yield from numbers_in(part, (*at, n))


def replaced(value: Any, at: Place, number: float) -> Any:
    if not at:
        return number
    if isinstance(value, dict):
        return {key: replaced(part, at[1:], number) if key == at[0] else part for key, part in value.items()}
    return [replaced(part, at[1:], number) if n == at[0] else part for n, part in enumerate(value)]


@st.composite
def spoilt(draw: st.DrawFn, message: Spoilable) -> Spoilable:
    """The message with some of its numbers changed; changes that are refused as it is decoded are left out."""
    builtins = msgspec.to_builtins(message)
    assert msgspec.convert(builtins, type(message)) == message, "before anything is changed"
    places = list(numbers_in(builtins))
    for _ in range(draw(st.integers(1, MOST_CHANGES))):
        place, number = draw(st.sampled_from(places))
        changed = replaced(builtins, place, draw(st.sampled_from(WHOLES if isinstance(number, int) else FLOATS)))
        with contextlib.suppress(msgspec.ValidationError):
            message, builtins = msgspec.convert(changed, type(message)), changed
    return message


@contextlib.contextmanager
def told(request: Message) -> Iterator[None]:
    """What goes wrong goes as to a client: in one line, and not as an internal error."""
    try:
        yield
    except Exception as error:
        cause = refusal(request, error).cause
        assert "internal error" not in cause and cause != OUT_OF_MEMORY, repr(error)


def held_at(path: Path) -> tuple[HeldVolume, messages.VolumeDescribed]:
    """The volume as packed halves."""
    held = HeldVolume()
    (described,) = held.answers(messages.DescribeVolume(str(path)))
    assert isinstance(described.message, messages.VolumeDescribed)
    held.answers(messages.ReadSubCubes(1, str(path), HALVES, described.message.identity))
    return held, described.message


SCENE = plain_scene(0.5, view=View(zoom=3.0), size=(20, 16))
EDGED = msgspec.structs.replace(SCENE, image=msgspec.structs.replace(SCENE.image, edges=True))


class Situation(msgspec.Struct):
    scene: Scene
    geometry: Geometry
    point: tuple[float, float]


def render(step: Step) -> messages.RenderFrame:
    drawing = Drawing.planned(EDGED, step, GEOMETRY, QUANTISATION, own_resolution(GEOMETRY, step))
    regions = RegionShares().regions(drawing.plan, {2: 1})
    light = LightBlocks((1, 1, 1), GEOMETRY.dims, bytes(range(240)), 0.5, 0.5) if drawing.plan.slabs else None
    return messages.RenderFrame(1, 1, drawing, {1: 1}, regions, exact=True, light=light)


@pytest.fixture(scope="module")
def drawing() -> Iterator[Owners]:
    with owners(2) as made:
        yield made


def draw(request: messages.RenderFrame, path: Path, drawing: Owners) -> None:
    """As a single process does, up to the finished image."""
    held, _ = held_at(path)
    held.answers(messages.PackVoxels(1, QUANTISATION))
    sub_cubes = held.sub_cubes_asked(request)
    news = Bell()
    assembly = FrameAssembly(drawing, request.drawing.plan, request.frame, slabs_of(request))
    walk = FrameWalk(sub_cubes, request.drawing, assembly.closed_tiles, request.regions, walkers=None)
    assembly.begin(request.regions, 0, news, walks=walk.walkers)
    wait_until_complete(assembly.splat, news)
    image = np.frombuffer(assembly.published(), np.float32)
    assert np.isfinite(image).all()


@pytest.mark.parametrize("step", Step)
def test_a_frame_of_good_numbers_is_drawn(path: Path, drawing: Owners, step: Step) -> None:
    """So that what is told below is told of the numbers."""
    draw(render(step), path, drawing)


def with_gradient(request: messages.RenderFrame, across: float, behind: float) -> messages.RenderFrame:
    drawing, shape = request.drawing, request.drawing.plan.slabs
    assert shape is not None
    slabs = msgspec.structs.replace(shape, gradient=((across, 0.0, 0.0), (0.0, across, 0.0), (0.0, 0.0, behind)))
    lighting = msgspec.structs.replace(drawing.shading.lighting, silhouettes=0.5)
    plan, shading = (
        msgspec.structs.replace(drawing.plan, slabs=slabs),
        msgspec.structs.replace(drawing.shading, lighting=lighting),
    )
    return msgspec.structs.replace(request, drawing=msgspec.structs.replace(drawing, plan=plan, shading=shading))


@pytest.mark.parametrize("gradient", [(1.0, 0.0), (1.0, 1e-30), (0.0, 0.0), (1e11, 1e11)])
def test_silhouettes_of_any_gradient_are_colours(path: Path, drawing: Owners, gradient: tuple[float, float]) -> None:
    draw(with_gradient(render(Step.G), *gradient), path, drawing)


def test_gradients_whose_squares_are_no_number_are_refused(path: Path, drawing: Owners) -> None:
    with pytest.raises(BadInput, match="too steep"):
        draw(with_gradient(render(Step.G), 1e25, 1.0), path, drawing)


@settings(max_examples=examples(150))
@given(data=st.data(), step=st.sampled_from(Step))
def test_a_frame_of_any_numbers(path: Path, drawing: Owners, data: st.DataObject, step: Step) -> None:
    request = data.draw(spoilt(render(step)))
    plan = request.drawing.plan
    if plan.width * plan.height > 10**6:
        return
    with told(request):
        draw(request, path, drawing)


@settings(max_examples=examples(100))
@given(data=st.data(), step=st.sampled_from(Step))
def test_a_scene_and_a_volume_of_any_numbers_are_planned_or_refused(data: st.DataObject, step: Step) -> None:
    """By the client, before anything is sent."""
    situation = data.draw(spoilt(Situation(EDGED, GEOMETRY, (9.0, 7.0))))
    with contextlib.suppress(ValueError):
        plan_frame(situation.scene, situation.geometry, step)
        shading_rule(situation.scene, step)
        line_of_sight(situation.scene, situation.geometry, *situation.point).check(
            sight_plan(situation.scene, situation.geometry)
        )


@settings(max_examples=examples(100))
@given(data=st.data())
def test_a_probe_of_any_numbers(path: Path, data: st.DataObject) -> None:
    drawing = Drawing.of(SCENE, sight_plan(SCENE, GEOMETRY), GEOMETRY, QUANTISATION)
    probe = messages.ProbeVoxels(1, 1, line_of_sight(SCENE, GEOMETRY, 9.0, 7.0), drawing)
    request = data.draw(spoilt(probe))
    held, _ = held_at(path)
    held.answers(messages.PackVoxels(1, QUANTISATION))
    with told(request):
        front_most(held.sub_cubes_asked(request), request.drawing, request.line)


@settings(max_examples=examples(250))
@given(data=st.data())
def test_requests_about_the_volume_with_any_numbers(path: Path, data: st.DataObject) -> None:
    held, described = held_at(path)
    part = messages.VolumePart(2, 0, 0, "int16", Box((0, 0, 0), (6, 5, 3)))
    kind = data.draw(st.sampled_from(["read", "count", "pack", "lend", "await", "hold"]))
    steps: dict[str, list[Message]] = {
        "read": [messages.ReadSubCubes(1, str(path), HALVES, described.identity)],
        "count": [messages.CountHistograms(1, 0.0, 119.0, 60.0)],
        "pack": [messages.PackVoxels(1, QUANTISATION)],
        "lend": [messages.LendVolume(1, str(path), described.identity), messages.ReadPart(1, part)],
        "await": [messages.AwaitParts(1, described.description, [HALVES[0]])],
        "hold": [messages.AwaitParts(1, described.description, [HALVES[0]]), messages.HoldPart(1, part)],
    }
    *before, last = steps[kind]
    for request in before:
        held.answers(request)
    spoilt_request = data.draw(spoilt(last))
    with told(spoilt_request):
        if isinstance(spoilt_request, messages.HoldPart):
            voxels = spoilt_request.part.box.voxels
            if voxels < 10**6:
                held.answers(spoilt_request, memoryview(bytes(voxels * SCALAR_BYTES[spoilt_request.part.scalar_type])))
        else:
            held.answers(spoilt_request)


@given(data=st.data(), sample=st.sampled_from(sorted(SAMPLES, key=lambda kind: kind.__name__)))
def test_any_message_with_any_numbers_is_taken_or_refused(data: st.DataObject, sample: type[Message]) -> None:
    message, _ = SAMPLES[sample]
    if list(numbers_in(msgspec.to_builtins(message))):
        data.draw(spoilt(message))


@pytest.mark.parametrize(
    ("geometry", "cause"),
    [
        ({"dims": (2**31, 1, 1)}, "at most"),
        ({"dims": (2**20, 2**20, 2**20)}, "at most"),
        ({"dims": (1, 1, 1), "origin": (float("inf"), 0.0, 0.0)}, "place in space"),
        (
            {"dims": (1, 1, 1), "index_to_physical": ((1e-170, 0.0, 0.0), (0.0, 1e100, 0.0), (0.0, 0.0, 1e100))},
            "place in space",
        ),
    ],
)
def test_a_grid_that_cannot_be_computed_with_is_refused_by_name(geometry: dict[str, Any], cause: str) -> None:
    with pytest.raises(ValueError, match=cause):
        Geometry(**geometry)


def test_boxes_beyond_the_volume_are_refused(path: Path) -> None:
    held, described = held_at(path)
    beyond = [Box((0, 0, 0), (6, 5, 5))]
    for request in (
        messages.ReadSubCubes(2, str(path), beyond, described.identity),
        messages.AwaitParts(2, VolumeDescription(name="", format="", geometry=GEOMETRY, scalar_type="int16"), beyond),
    ):
        with pytest.raises(BadInput, match="beyond the volume"):
            held.answers(request)


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("numbers", "cause"),
    [
        ({"window": (1.0, 1.0)}, "window must be finite and rise"),
        ({"window": (NAN, 1.0)}, "window must be finite and rise"),
        ({"window": (0.0, INF)}, "window must be finite and rise"),
        ({"window": (0.0, 5e-324)}, "window must be finite and rise"),
        ({"strength_scale": NAN}, "strength must have a finite scale"),
        ({"strength_scale": -1.0}, "strength must have a finite scale"),
        ({"strength_scale": INF}, "strength must have a finite scale"),
        ({"strength_low": NAN}, "strength must have a finite scale"),
    ],
)
def test_a_rule_of_bytes_that_cannot_be_computed_with_is_refused_by_name(numbers: dict[str, Any], cause: str) -> None:
    good: dict[str, Any] = {"window": (0.0, 255.0), "strength_scale": 8.0}
    with pytest.raises(ValueError, match=cause):
        Quantisation(**(good | numbers))


def test_gradients_too_weak_for_a_scale_are_none() -> None:
    assert strength_scale(Survey(low=0.0, high=1.0, max_gradient=5e-324, voxels=8, no_data=0), [0, 8]) == 0.0


def test_levels_that_a_volume_lacks_are_refused(path: Path) -> None:
    held, _ = held_at(path)
    request = render(Step.C)
    replaced, drawn, other = msgspec.structs.replace, request.drawing, Geometry((6, 5, 3))
    with pytest.raises(BadInput, match=r"has \(6, 5, 4\) voxels, not \(6, 5, 3\)"):
        held.sub_cubes_asked(replaced(request, drawing=replaced(drawn, geometry=other)))
    with pytest.raises(BadInput, match=r"has \(6, 5, 4\) voxels, not \(3, 5, 4\)"):
        coarser = replaced(drawn, plan=replaced(drawn.plan, factors=(2, 1, 1)))
        held.sub_cubes_asked(replaced(request, drawing=coarser))
    with pytest.raises(BadInput, match="level 1 is not held"):
        held.sub_cubes_asked(replaced(request, drawing=replaced(drawn, level=1)))
    thin, wide = (
        ((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, c)) for a, b, c in ((1e-160, 1e100, 1e60), (1e153, 1.0, 1.0))
    )
    with pytest.raises(ValueError, match="that of no level"):
        factors_of(Geometry((1, 1, 1), thin), Geometry((1, 1, 1), wide))
    with pytest.raises(ValueError, match="are no level"):
        factors_of(GEOMETRY, other)
    for stride in (0, 5, 2**62):
        with pytest.raises(ValueError, match="strides must be 1 to 4"):
            Resolution(level=0, geometry=GEOMETRY, stride=stride)


def test_a_centre_that_is_nowhere_on_the_screen_is_refused() -> None:
    """Its place there is infinity less infinity, on both axes."""
    nowhere = View(zoom=256.0, rotation=(0.4, 0.3, 0.2, 0.9), center=(1.7e308, 1.7e308, 1.7e308))
    with pytest.raises(ValueError, match="pixels from the image"):
        plan_frame(plain_scene(view=nowhere), GEOMETRY, Step.C)


def test_boxes_that_lie_in_no_volume_or_are_none_are_refused_as_they_arrive(path: Path) -> None:
    _, described = held_at(path)
    read = messages.ReadSubCubes(2, str(path), HALVES, described.identity)
    with pytest.raises(ValueError, match="lies in no volume"):
        msgspec.structs.replace(read, boxes=[Box((0, 0, 0), (2**31, 1, 1))])
    waits = messages.AwaitParts(2, described.description, HALVES)
    for request in (read, waits):
        with pytest.raises(msgspec.ValidationError, match="length >= 1"):
            msgspec.convert(msgspec.to_builtins(request) | {"boxes": []}, type(request))


def test_a_part_beyond_the_volume_is_not_lent(path: Path) -> None:
    held, described = held_at(path)
    held.answers(messages.LendVolume(1, str(path), described.identity))
    with pytest.raises(BadInput, match="beyond the volume"):
        held.answers(messages.ReadPart(1, messages.VolumePart(2, 0, 0, "int16", Box((0, 0, 0), (6, 5, 5)))))
