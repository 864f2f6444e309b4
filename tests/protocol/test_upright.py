"""Which way is up: stated, guessed or set, it turns a volume under every view name and never mirrors it."""

import math
from pathlib import Path

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from reference import mapping
from support.scenes.arbitrary import plain_scene
from tolerances import ROUNDING
from volsplat.client.command.render_options import SceneOptions
from volsplat.client.movie.key_frames import key_framed, turntable
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.view_sides import sides
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.up_guess import guessed_up
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.scene import Scene, Shading, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.view_rotation import VIEW_NAMES, named_view, rotation_from_angles
from volsplat.protocol.description.volume import Geometry, GridAxis, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.upright import UPS, Up, upright
from volsplat.protocol.rules.resolved_view import screen_rotation

SAME_PICTURE = 0.01  # mean of all differences: positions are rounded to 1/64 pixel, from another side of the grid
UNPLACED = Geometry((40, 44, 48))


def head(air: float = 0.0, flesh: float = 120.0) -> Tensor:
    """(k, j, i): a crown that tapers towards +z, a nose towards -y, an ear at +x alone, a neck that is cut at k = 0."""
    k, j, i = torch.meshgrid(*(torch.arange(n).double() for n in (48, 44, 40)), indexing="ij")
    x, y, z = i - 19.5, j - 21.5, k - 26.0
    skull = (x / 15) ** 2 + (y / 17) ** 2 + (z / 19) ** 2 <= 1
    neck = (x**2 + (y - 3) ** 2 <= 81) & (z < 0)
    nose = (x.abs() < 3) & (y > -21) & (y < -14) & ((z + 2).abs() < 4)
    ear = (x > 13) & (x < 18) & (y.abs() < 4) & (z.abs() < 5)
    return torch.where(skull | neck | nose | ear, flesh, air).float()


def upside_down(values: Tensor) -> Tensor:
    """Turned by half a turn about y, as a stack that counts from the top down; not mirrored."""
    return values.flip(0).flip(2)


def guess(values: Tensor) -> Up | None:
    nk, nj, ni = values.shape
    geometry = Geometry((ni, nj, nk))
    cube = SubCube.of_volume(geometry, values.contiguous())
    survey = cube.survey()
    return guessed_up(geometry, cube.histograms(survey.low, survey.high, survey.max_gradient).extremes)


# -- the rotation


@pytest.mark.parametrize("up", UPS)
def test_up_turns_its_axis_to_z_and_mirrors_nothing(up: Up) -> None:
    axis = tuple(float((up[1] == letter) * (1 if up[0] == "+" else -1)) for letter in "xyz")
    assert matrices.applied(upright(up), (axis[0], axis[1], axis[2])) == (0.0, 0.0, 1.0)
    assert matrices.determinant(upright(up)) == 1.0
    assert matrices.product(upright(up), matrices.transposed(upright(up))) == matrices.IDENTITY


@given(up=st.sampled_from(UPS), azimuth=st.floats(-180, 180), elevation=st.floats(-90, 90))
def test_the_plan_turns_as_the_reference_does(up: Up, azimuth: float, elevation: float) -> None:
    scene = plain_scene(view=View(rotation=rotation_from_angles(azimuth, elevation), up=up, zoom=1.0))
    expected = mapping.steps_on_screen(scene, Geometry((3, 3, 3)))
    found = torch.tensor(screen_rotation(scene.view), dtype=torch.float64)
    assert torch.allclose(found, expected, rtol=0, atol=ROUNDING)


def test_without_a_volume_up_is_z() -> None:
    assert upright("auto") == upright("+z") == matrices.IDENTITY


# -- the guess


def test_the_end_that_tapers_is_up_where_the_other_is_cut() -> None:
    assert guess(head()) == "+z"
    assert guess(upside_down(head())) == "-z"


def test_what_is_alike_at_both_ends_is_not_guessed() -> None:
    assert guess(torch.zeros(9, 9, 9)) is None
    assert guess(torch.rand(20, 20, 20, generator=torch.Generator().manual_seed(1989))) is None
    k, j, i = torch.meshgrid(*[torch.arange(40) - 19.5] * 3, indexing="ij")
    assert guess((i**2 + j**2 + k**2 < 225).float()) is None


@given(
    margin=st.lists(st.integers(0, 40), min_size=6, max_size=6),
    filled=st.sampled_from([0.0, -1000.0, -2000.0, math.nan]),
    turned=st.booleans(),
)
def test_a_margin_changes_no_guess(margin: list[int], filled: float, turned: bool) -> None:
    values = head(air=-1000.0, flesh=40.0)
    values = upside_down(values) if turned else values
    padded = torch.nn.functional.pad(values, margin, value=filled)
    assert guess(padded) == ("-z" if turned else "+z")


def test_noise_in_the_air_changes_no_guess() -> None:
    noise = 60 * torch.rand((48, 44, 40), generator=torch.Generator().manual_seed(1989))
    assert guess(head(flesh=1000.0) + noise) == "+z"
    assert guess(upside_down(head(flesh=1000.0)) + noise) == "-z"


# -- what obeys it


@pytest.fixture(scope="module")
def stacks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """One head stored upright, upside down, and upside down in a margin, none of which tells how it lies."""
    folder = tmp_path_factory.mktemp("stacks")
    stored = {
        "upright": head(),
        "upside down": upside_down(head()),
        "in a margin": torch.nn.functional.pad(upside_down(head()), [9, 9, 9, 9, 30, 11]),
    }
    names = {}
    for name, values in stored.items():
        path = folder / f"{name.replace(' ', '-')}.raw"
        path.write_bytes(values.contiguous().numpy().astype("<f4").tobytes())
        nk, nj, ni = values.shape
        names[name] = f"{path}#dims={ni}x{nj}x{nk},type=float32,endian=little"
    return names


def looking(rotation: tuple[float, float, float, float], **view: object) -> Scene:
    scene = plain_scene(size=(60, 60))
    return msgspec.structs.replace(
        scene,
        tables=msgspec.structs.replace(scene.tables, opac=ScalarTable(points=((0.4, 0.0), (0.4, 1.0)))),
        shading=Shading(diffuse=True, specular=False, modulation=False),
        view=View(rotation=rotation, **view),  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("stored", ["upside down", "in a margin"])
def test_a_stack_is_seen_upright_under_every_name_and_angle(stacks: dict[str, str], stored: str) -> None:
    rotations = [*map(named_view, VIEW_NAMES), rotation_from_angles(30, 10), rotation_from_angles(0, 30)]
    with SingleProcess(stacks["upright"]) as one, SingleProcess(stacks[stored]) as other:
        assert one.volume.stands_up.up == "+z" and other.volume.stands_up.up == "-z"
        for rotation in rotations:
            expected = one.render(looking(rotation, zoom=1.0))
            zoomed = msgspec.structs.replace(looking(rotation, zoom=1.0))
            if stored == "in a margin":  # about the same point of the head
                middle = (9 + 19.5, 9 + 21.5, 30 + 23.5)
                zoomed = looking(rotation, zoom=1.0, center=middle)
            found = other.render(zoomed)
            assert expected[..., 3].mean() > 0.1
            assert (found - expected).abs().mean() <= SAME_PICTURE
            assert (found.flip(1) - expected).abs().mean() > SAME_PICTURE or rotation in BOTH_SIDES_ALIKE


BOTH_SIDES_ALIKE = (named_view("left"), named_view("right"))  # but for nose and neck, which are well apart


def test_what_is_set_wins_over_guess_and_file(stacks: dict[str, str], tmp_path: Path) -> None:
    write_volume(tmp_path / "placed.nrrd", head(), UNPLACED)  # in LPS
    for name, own in ((stacks["upside down"], "-z"), (str(tmp_path / "placed.nrrd"), "+z")):
        with SingleProcess(name) as single:
            assert single.volume.settled(single.volume.default_scene()).view.up == own
            for up in UPS:
                scene = SceneOptions(changes={"view.up": up}).scene_of(single.volume)
                assert scene.view.up == single.volume.settled(scene).view.up == up
                turned = looking(named_view("front"), zoom=1.0, up=up)
                by_hand = msgspec.structs.replace(
                    turned,
                    view=View(
                        rotation=matrices.quaternion_from_rotation(screen_rotation(turned.view)), up="+z", zoom=1.0
                    ),
                )
                assert (single.render(turned) - single.render(by_hand)).abs().mean() <= SAME_PICTURE


def test_servers_see_it_as_one_process_does(stacks: dict[str, str]) -> None:
    scene = looking(rotation_from_angles(30, 10))
    with SingleProcess(stacks["upside down"]) as single, Session(stacks["upside down"], workers=2) as session:
        assert session.volume.extremes == single.volume.extremes
        assert session.volume.settled(scene) == single.volume.settled(scene)
        assert torch.equal(session.render(scene), single.render(scene))


def test_a_turntable_turns_about_the_upright_axis() -> None:
    scene = looking(named_view("front"), up="-z", zoom=1.0)
    for axis in ("screen-y", "grid-k"):
        for turned in turntable(scene, UNPLACED, 8, axis):
            down = matrices.applied(screen_rotation(turned.view), (0.0, 0.0, 1.0))
            assert down == pytest.approx((0.0, -1.0, 0.0), abs=ROUNDING)


def test_between_keys_of_different_up_the_way_is_the_shortest() -> None:
    first = looking(named_view("front"), up="+z", zoom=1.0)
    last = looking(named_view("front"), up="+x", zoom=1.0)
    scenes = key_framed([first, last], UNPLACED, 5)
    seen = [screen_rotation(scene.view) for scene in scenes]
    assert (seen[0], seen[-1]) == (screen_rotation(first.view), screen_rotation(last.view))
    for one, other in zip(seen, seen[1:], strict=False):
        trace = sum(matrices.product(other, matrices.transposed(one))[n][n] for n in range(3))
        assert math.degrees(math.acos((trace - 1) / 2)) == pytest.approx(90 / 4, abs=1e-6)


def test_sides_are_named_by_what_lies_there() -> None:
    told = VolumeDescription(name="a", format="raw", geometry=UNPLACED, scalar_type="uint8")
    assert {name: side.words for name, side in sides(told, "-z").items()} == {
        "front": "-y",
        "back": "+y",
        "left": "-x",
        "right": "+x",
        "top": "-z",
        "bottom": "+z",
    }
    patient = msgspec.structs.replace(told, anatomical=True)
    assert patient.up == "+z"
    assert [side.mark for side in sides(patient, "+z").values()] == ["A", "P", "L", "R", "S", "I"]
    assert [side.mark for side in sides(patient, "-y").values()] == ["I", "S", "L", "R", "A", "P"]


def test_sides_of_named_axes_tell_where_these_lead() -> None:
    axes = (GridAxis("time", "ms", 4.0, 4.0), GridAxis("crossline", "", 875.0, 1.0), GridAxis("RA", "deg", 9.0, -0.1))
    down_right_back = Geometry(dims=(8, 8, 8), index_to_physical=((0.0, 1.0, 0.1), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)))
    told = VolumeDescription(name="a", format="SEG-Y", geometry=down_right_back, scalar_type="uint8", axes=axes)
    marks = {name: side.mark for name, side in sides(told, "+z").items()}
    assert marks == {"front": "RA+", "back": "RA−", "left": "XL+", "right": "XL−", "top": "time−", "bottom": "time+"}
    assert sides(told, "+z")["back"].words == "smaller RA"
