"""What a script hands to a session: converted if it means something, refused for the caller if not."""

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import torch

from support.files.head_volume import head, single, skin
from volsplat.client import Session
from volsplat.client.coordinator.events.instructions import Send
from volsplat.client.image.image_file import write_image
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Image, Order, Quantise, Scene, View
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.levels import Thinning
from volsplat.protocol.text.errors import BadInput, VolsplatError

__all__ = ["head", "single"]

Renderer = Session | SingleProcess
replaced = msgspec.structs.replace


def other(value: object) -> Any:
    """An argument that no type checker would let through."""
    return value


class OwnFloat(float):
    """A float by inheritance, as many libraries have them."""


@pytest.fixture(scope="module")
def session(head: Path) -> Iterator[Session]:
    with Session(head, workers=other(np.int64(2)), memory=other(torch.tensor(2**30))) as session:
        yield session


@pytest.fixture(params=["session", "single"])
def renderer(request: pytest.FixtureRequest) -> Renderer:
    renderer: Renderer = request.getfixturevalue(request.param)
    return renderer


SAME: dict[str, Callable[[Scene], Scene]] = {  # of a scene with these in Python's own numbers
    "numpy's scalar": lambda scene: _zoomed(scene, np.float64(2)),
    "numpy's single": lambda scene: _zoomed(scene, np.float32(2)),
    "a numpy integer": lambda scene: _zoomed(scene, np.int16(2)),
    "an array without axes": lambda scene: _zoomed(scene, np.array(2.0)),
    "torch's scalar": lambda scene: _zoomed(scene, torch.tensor(2.0)),
    "an integer": lambda scene: _zoomed(scene, 2),
    "a fraction": lambda scene: _zoomed(scene, Fraction(2)),
    "a float by inheritance": lambda scene: _zoomed(scene, OwnFloat(2)),
    "a tuple of scalars": lambda scene: _centred(_zoomed(scene, 2.0), tuple(np.float64(n) for n in _center(scene))),
    "a list": lambda scene: _centred(_zoomed(scene, 2.0), list(_center(scene))),
    "an array": lambda scene: _centred(_zoomed(scene, 2.0), np.array(_center(scene))),
    "a tensor": lambda scene: _centred(_zoomed(scene, 2.0), torch.tensor(_center(scene))),
    "words in place of names": lambda scene: replaced(_zoomed(scene, 2.0), order=other("btf")),
    "numpy's bool and size": lambda scene: replaced(
        _zoomed(scene, 2.0),
        image=Image(width=other(np.int64(96)), height=other(np.uint16(80)), edges=other(np.bool_(False))),
    ),
    "bounds as lists": lambda scene: replaced(_zoomed(scene, 2.0), bounds=Bounds(low=other([0, 0, 0]))),
}


def _zoomed(scene: Scene, zoom: Any) -> Scene:
    return replaced(scene, view=View(rotation=scene.view.rotation, zoom=zoom, center=_center(scene)))


def _centred(scene: Scene, center: Any) -> Scene:
    return replaced(scene, view=View(rotation=scene.view.rotation, zoom=scene.view.zoom, center=center))


def _center(scene: Scene) -> tuple[float, float, float]:
    return (10.5, 11.25, 12.0)


@pytest.mark.parametrize("make", SAME.values(), ids=SAME)
def test_numbers_of_other_libraries_draw_the_same_bits(
    renderer: Renderer, make: Callable[[Scene], Scene], single: SingleProcess
) -> None:
    scene = replaced(skin(single), order=Order.BACK_TO_FRONT)
    plain = single.render(_zoomed(scene, 2.0))
    assert torch.equal(renderer.render(make(scene)), plain)


BAD: dict[str, tuple[Callable[[Renderer, Scene], object], str]] = {
    "a preset's name": (lambda r, scene: r.render(other("ct-bone")), "a Scene is wanted, not the str 'ct-bone'"),
    "no scene": (lambda r, scene: r.finish(other(None)), "a Scene is wanted, not the NoneType None"),
    "a dictionary": (lambda r, scene: r.refine(other({"view": 1})), "a Scene is wanted"),
    "a text as zoom": (lambda r, scene: r.render(_zoomed(scene, "fitt")), r"fitt.*zoom|zoom.*fitt"),
    "two numbers as bounds": (lambda r, scene: r.render(replaced(scene, bounds=Bounds(low=other((1, 2))))), r"low"),
    "an endless number": (lambda r, scene: r.render(replaced(scene, bounds=Bounds(low=(10**30, 0, 0)))), "cannot"),
    "an object": (lambda r, scene: r.render(replaced(scene, order=other(object()))), "neither a number nor a word"),
    "half an index": (lambda r, scene: r.render(replaced(scene, bounds=Bounds(high=(other(9.5), 9, 9)))), "high"),
    "a tensor on no device": (lambda r, scene: r.render(_zoomed_late(scene, torch.empty((), device="meta"))), "number"),
    "step Z": (
        lambda r, scene: r.render(scene, other("Z")),
        "step must be one of A, B, C, D, E, F, G, not the str 'Z'",
    ),
    "step 3": (lambda r, scene: r.finish(scene, other(3)), "step must be one of"),
    "no step": (lambda r, scene: r.finish(scene, other(None)), "step must be one of"),
    "no first step": (lambda r, scene: r.refine(scene, first=other(None)), "first must be one of"),
    "no last step": (lambda r, scene: r.refine(scene, last=other("last")), "last must be one of"),
    "no exact steps": (lambda r, scene: r.refine(scene, exact=other(1)), "exact must be steps"),
    "a text as interval": (lambda r, scene: r.refine(scene, partial_interval=other("1")), "partial_interval"),
    "a negative interval": (lambda r, scene: r.refine(scene, partial_interval=-1), "partial_interval"),
    "no interval": (lambda r, scene: r.refine(scene, partial_interval=float("nan")), "partial_interval"),
    "a point by a name": (lambda r, scene: r.probe(scene, other("middle"), 0), "x must be a number"),
    "a point nowhere": (lambda r, scene: r.probe(scene, 0, other(None)), "y must be a number, not the NoneType None"),
    "half a voxel": (lambda r, scene: r.file_voxel(other((1, 2.5, 3))), "index must be three whole numbers"),
    "a voxel on two axes": (lambda r, scene: r.file_voxel(other([1, 2])), "index must be three whole numbers"),
    "a voxel beyond the volume": (lambda r, scene: r.file_voxel((0, 0, 36)), "there is no voxel .0, 0, 36. in a"),
    "a voxel before it": (lambda r, scene: r.file_voxel((-1, 0, 0)), "there is no voxel .-1, 0, 0. in a volume"),
    "a point in a text": (lambda r, scene: r.probe(other("front"), 0, 0), "a Scene is wanted"),
}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"thinning": 1}, r"thinning must be a Thinning, as Thinning\(octaves=1\), not the int 1"),
        ({"thinning": None}, "thinning must be a Thinning"),
        ({"thinning": Thinning(octaves=other("a"))}, "thinning.octaves must be a whole number from 0 on"),
        ({"thinning": Thinning(octaves=10**12)}, "strides must be 1 to 4"),
        ({"thinning": Thinning(rows=0)}, "thinning.rows must be 1 or more"),
        ({"thinning": Thinning(frozen_alpha=other("all"))}, "thinning.frozen_alpha must be a number"),
        ({"exact": None}, r"exact must be steps, as \(Step.F,\), not the NoneType None"),
        ({"exact": ("F", "Z")}, "exact must be one of A, B, C, D, E, F, G, not the str 'Z'"),
    ],
)
def test_what_refinement_cannot_go_by_is_refused_and_the_session_goes_on(
    renderer: Renderer, single: SingleProcess, options: Any, told: str
) -> None:
    with pytest.raises(BadInput, match=told):
        list(renderer.refine(skin(renderer), **options))
    assert torch.equal(renderer.render(skin(single), "D"), single.render(skin(single), "D"))


def test_a_single_process_leaves_out_the_voxels_that_a_session_does(session: Session, single: SingleProcess) -> None:
    scene, thinning = skin(single), Thinning(sheets=2)
    (drawn,), (alone,) = (
        list(each.refine(scene, "F", float("inf"), "F", thinning=thinning)) for each in (session, single)
    )
    assert torch.equal(drawn.image, alone.image) and not torch.equal(alone.image, single.render(scene))


def _zoomed_late(scene: Scene, zoom: Any) -> Scene:
    """Past the scene's own check, as deserialised and forced values may be."""
    view = View()
    msgspec.structs.force_setattr(view, "zoom", zoom)
    return replaced(scene, view=view)


@pytest.mark.parametrize(("ask", "told"), BAD.values(), ids=BAD)
def test_what_makes_no_sense_is_told_to_the_caller_and_the_next_call_draws(
    renderer: Renderer, ask: Callable[[Renderer, Scene], object], told: str, single: SingleProcess
) -> None:
    scene = skin(single)
    with pytest.raises(BadInput, match=told) as refused:
        ask(renderer, scene)
    assert "\n" not in str(refused.value)
    assert torch.equal(renderer.render(scene, Step.D), single.render(scene, Step.D))


def test_steps_points_and_intervals_may_be_other_libraries_too(renderer: Renderer, single: SingleProcess) -> None:
    scene = skin(single)
    assert torch.equal(renderer.render(scene, other("D")), single.render(scene, Step.D))
    assert renderer.probe(scene, other(np.float32(48)), other(torch.tensor(40.0))) == single.probe(scene, 48.0, 40.0)
    drawn = list(renderer.refine(scene, other("B"), partial_interval=float("inf")))
    assert [refinement.step for refinement in drawn if refinement.complete] == [Step.A, Step.B]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"volume": ""}, "a volume's path or URL, or an array, is wanted"),
        ({"volume": [[[1]]]}, r"not the list \[\[\[1\]\]\]; make an array of it by np.array"),
        ({"workers": "2"}, "workers must be a whole number, not the str '2'"),
        ({"workers": 2.5}, "workers must be a whole number"),
        ({"workers": 0}, "workers must be 1 or more"),
        ({"workers": 100_000}, "100001 servers are too many for this machine, where 256 start at the most"),
        ({"workers": 1, "splat_servers": 256}, "257 servers are too many"),
        ({"memory": 2.5}, "memory must be a whole number"),
        ({"memory": "2X"}, "memory 2X: give a size such as 800M or 4G"),
        ({"listen": 7411}, "listen must be an Address or HOST:PORT"),
        ({"listen": "nowhere"}, "HOST:PORT"),
        ({"spawn": False, "threads": 2}, "starts no servers that it would hold for; leave out threads"),
        ({"spawn": False, "data_root": "."}, "leave out data_root"),
        (
            {"cluster": "lab.toml", "workers": 8, "tls": False},
            "the cluster file says this .*; leave out tls and workers",
        ),
        ({"cluster": "lab.toml", "data_root": "."}, "leave out data_root"),
    ],
)
def test_a_session_for_nothing_is_refused_before_anything_starts(head: Path, arguments: Any, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        Session(**{"volume": head, **arguments})


def test_what_cannot_be_encoded_ends_its_frame_and_no_server(head: Path, single: SingleProcess) -> None:
    """A mistake of ours, behind the border: a message that msgpack cannot carry."""
    with Session(head, workers=2) as session:
        scene = skin(session)
        image = session.render(scene)
        carry_out = session._coordination._carry_out

        def broken(instruction: Any, links: Any) -> None:
            if isinstance(instruction, Send) and isinstance(instruction.message, messages.RenderFrame):
                drawing = instruction.message.drawing
                plan = replaced(drawing.plan, order=other(object()))
                message = replaced(instruction.message, drawing=replaced(drawing, plan=plan))
                instruction = replaced_instruction(instruction, message)
            carry_out(instruction, links)

        session._coordination._carry_out = broken  # type: ignore[method-assign]
        with pytest.raises(VolsplatError, match="RenderFrame cannot be sent"):
            session.render(scene)
        session._coordination._carry_out = carry_out  # type: ignore[method-assign]
        assert torch.equal(session.render(scene), image)
        assert not any(server.lost for server in session.servers)


def replaced_instruction(instruction: Send, message: messages.Message) -> Send:
    return Send(instruction.server, message, instruction.payload)


def test_an_image_is_written_with_the_numbers_of_its_scene(tmp_path: Path, single: SingleProcess) -> None:
    scene = _zoomed(skin(single), np.float64(2))
    write_image(tmp_path / "a.png", single.render(scene), scene)
    write_image(tmp_path / "b.png", single.render(scene), _zoomed(skin(single), 2.0))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_window_may_be_an_array(renderer: Renderer, single: SingleProcess) -> None:
    scene = skin(single)
    window = Quantise(window=other(np.array([500.0, 1500.0])))
    plain = replaced(scene, quantise=Quantise(window=(500.0, 1500.0)))
    assert torch.equal(renderer.render(replaced(scene, quantise=window)), single.render(plain))
