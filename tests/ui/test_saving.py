"""What the page saves: images with their scene, scenes as files and links, movies on a thread."""

import base64
import string
import threading
import zlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from torch import Tensor

from support.files.images import over_background, read_image
from support.patience import PATIENCE
from support.scenes.arbitrary import plain_scene, situations
from support.scenes.scenes import scenes
from tolerances import HALF_A_LEVEL, ROUNDING
from volsplat.client.figure.figure import Figure
from volsplat.client.image.image_file import read_scene
from volsplat.client.movie.key_frames import turntable
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.scene_file import scene_from_toml
from volsplat.client.session.renderer import Refinement
from volsplat.client.session.single import SingleProcess
from volsplat.client.ui.viewing.saving import (
    MovieJob,
    figure_bytes,
    image_bytes,
    scene_bytes,
    scene_from_link,
    scene_in_file,
    scene_link,
)
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Refine, Scene
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.text.errors import BadInput

BASE_URL = "http://127.0.0.1:8080/?token=a-b_c"
URL_SAFE = set(string.ascii_letters + string.digits + "-_")
DESCRIPTION = VolumeDescription(name="head", format="NRRD", geometry=Geometry(dims=(8, 9, 10)), scalar_type="uint8")


def picture() -> Tensor:
    generator = torch.Generator().manual_seed(1)
    alpha = torch.rand((5, 7, 1), generator=generator)
    return torch.cat([torch.rand((5, 7, 3), generator=generator) * alpha, alpha], dim=2)


# -- images and scenes


def test_png_lies_on_the_background_and_exr_keeps_every_bit_and_both_hold_the_scene(tmp_path: Path) -> None:
    scene = msgspec.structs.replace(plain_scene(), image=Image(background=(0.25, 0.5, 1.0)))
    for kind in ("png", "exr"):
        (tmp_path / f"saved.{kind}").write_bytes(image_bytes(picture(), scene, kind, DESCRIPTION))
        assert read_scene(tmp_path / f"saved.{kind}") == scene
    shown = over_background(picture(), scene.image.background)
    assert (read_image(tmp_path / "saved.png") - shown).abs().max() <= HALF_A_LEVEL["uint8"]
    assert torch.equal(read_image(tmp_path / "saved.exr"), picture())


def test_a_figure_has_the_width_in_print_and_the_part_of_the_volume_that_the_page_shows(
    single: SingleProcess, tmp_path: Path
) -> None:
    shown = single.volume.settled(single.volume.default_scene().with_(size=(90, 60)))
    figure, saved = Figure(width=2.54, dpi=180, colour_bar=False), tmp_path / "figure.png"
    data = figure_bytes(single, shown, figure, ".png", lambda: False)
    assert data is not None
    saved.write_bytes(data)
    assert read_image(saved).shape[:2] == (120, 180)
    zoom = read_scene(saved).view.zoom
    assert zoom != "fit" and shown.view.zoom != "fit" and zoom == pytest.approx(2 * shown.view.zoom, rel=ROUNDING)
    assert figure_bytes(single, shown, figure, ".png", lambda: True) is None
    with pytest.raises(BadInput, match="do not have"):
        figure_bytes(single, shown, Figure(title="頭"), ".pdf", lambda: False)


@given(scenes())
def test_a_saved_scene_reads_as_itself(scene: Scene) -> None:
    assert scene_from_toml(scene_bytes(scene).decode(), plain_scene(), "saved") == scene
    marked = scene_bytes(scene).decode().encode("utf-8-sig")  # as editors on Windows save it
    assert scene_in_file(scene_bytes(scene), plain_scene(), "a.toml") == scene
    assert scene_in_file(marked, plain_scene(), "a.toml") == scene


# -- links


@given(scene=scenes(), base=scenes())
def test_a_link_gives_its_scene_back_over_the_scene_it_was_made_from(scene: Scene, base: Scene) -> None:
    link = scene_link(BASE_URL, scene, base)
    address, _, text = link.partition("&scene=")
    assert address == BASE_URL and set(text) <= URL_SAFE
    assert scene_from_link(link, base) == scene_from_link(text, base) == scene


@given(situations())
def test_a_link_holds_a_view_and_bounds_of_a_volume(situation: tuple[Scene, object]) -> None:
    scene, _ = situation
    assert scene_from_link(scene_link(BASE_URL, scene, plain_scene()), plain_scene()) == scene


def test_a_link_holds_only_what_differs() -> None:
    base = plain_scene()
    turned = msgspec.structs.replace(base, view=msgspec.structs.replace(base.view, zoom=2.0))
    other = plain_scene(opacity=0.5, size=(99, 88))
    assert scene_from_link(scene_link(BASE_URL, turned, base), other) == msgspec.structs.replace(
        other, view=msgspec.structs.replace(other.view, zoom=2.0)
    )


def test_a_link_of_a_link_holds_one_scene() -> None:
    first = scene_link(BASE_URL, plain_scene(opacity=0.25), plain_scene())
    second = scene_link(first, plain_scene(opacity=0.5), plain_scene())
    assert second.count("scene=") == 1
    assert scene_from_link(second, plain_scene()) == plain_scene(opacity=0.5)


def linked(content: bytes) -> str:
    return base64.urlsafe_b64encode(zlib.compress(content)).decode().rstrip("=")


GARBAGE = {
    "nothing": ("", "holds no"),
    "words": ("what is this?", "holds no scene"),
    "another alphabet": ("blä", "holds no scene"),
    "not packed": (base64.urlsafe_b64encode(b"{}").decode(), "holds no scene"),
    "cut short": (linked(b'{"order":"ftb"}')[:-8], "holds no"),
    "too large": (linked(b" " * (1 << 21)), "holds no whole scene"),
    "not JSON": (linked(b"order = 'ftb'"), "holds no scene"),
    "not UTF-8": (linked(b'{"order":"\xff"}'), "holds no scene"),
    "nested deeply": (linked(b"[" * 100000), "holds no scene"),
    "a list": (linked(b"[]"), "cannot be used"),
    "an unprintable key": (linked(b'{"zo\\nom":1}'), "cannot be used"),
    "half an address": ("http://[", "holds no scene"),
    "unknown key": (linked(b'{"zoom":1}'), "cannot be used.*zoom"),
    "bad value": (linked(b'{"view":{"zoom":-1}}'), "cannot be used.*zoom must be 1/64 to 256"),
    "a part that is none": (linked(b'{"view":7}'), "cannot be used.*view"),
}


@pytest.mark.parametrize("case", GARBAGE)
def test_a_link_that_is_none_is_refused_in_one_line(case: str) -> None:
    text, named = GARBAGE[case]
    with pytest.raises(BadInput, match=named) as raised:
        scene_from_link(text, plain_scene())
    assert "\n" not in str(raised.value)


@example("http://[?scene=a")
@given(st.text() | st.binary().map(linked) | st.text(sorted(URL_SAFE)))
def test_anything_is_a_scene_or_refused(text: str) -> None:
    try:
        scene_from_link(text, plain_scene())
    except BadInput as error:
        assert str(error).isprintable()


# -- movies


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volumes") / "head.nrrd"
    write_volume(path, *make_phantom("head", size=(16, 20, 18)))
    return path


def turn(single: SingleProcess, frames: int) -> list[Scene]:
    return turntable(plain_scene(size=(24, 16)), single.volume.description.geometry, frames)


class Gated(SingleProcess):
    """Draws each frame only when the test lets it."""

    def __init__(self, volume: Path) -> None:
        super().__init__(volume)
        self.asked = threading.Semaphore(0)
        self.let = threading.Semaphore(0)

    def finish(self, scene: Scene, step: Step | str = Step.F) -> Refinement:
        self.asked.release()
        assert self.let.acquire(timeout=PATIENCE)
        return super().finish(scene, step)


@pytest.fixture
def gated(head: Path) -> Iterator[Gated]:
    with closing(Gated(head)) as process:
        yield process


@pytest.fixture
def single(head: Path) -> Iterator[SingleProcess]:
    with SingleProcess(head) as process:
        yield process


def test_a_job_tells_how_far_it_is_and_ends_whole(gated: Gated, tmp_path: Path) -> None:
    job = MovieJob(gated, turn(gated, 3), tmp_path / "turn")
    assert (job.done, job.progress, job.whole) == (False, 0.0, False)
    seen = []
    for _ in range(3):
        assert gated.asked.acquire(timeout=PATIENCE)
        seen.append((job.progress, job.line.partition(",")[0]))  # after the comma, the time that is left
        gated.let.release()
    job.join()
    assert seen == [(0.0, "starting"), (0.25, "image 1 of 3"), (0.5, "image 2 of 3")]
    assert (job.done, job.whole, job.progress, job.error) == (True, True, 1.0, None)
    assert job.line == "3 images"
    assert len(list((tmp_path / "turn").iterdir())) == 3


def test_a_movie_of_figures_has_the_plain_pictures_in_it(single: SingleProcess, tmp_path: Path) -> None:
    about = Figure(scale_bar=False, sides=False, title="h", dpi=60)
    for folder, figure in (("plain", None), ("figures", about)):
        job = MovieJob(single, turn(single, 2), tmp_path / folder, figure=figure)
        job.join()
        assert job.whole, job.error
    plain, figures = (read_image(tmp_path / folder / "frame-00002.png") for folder in ("plain", "figures"))
    height, width, _ = plain.shape
    below = next(n for n in range(figures.shape[0]) if torch.equal(figures[n : n + height], plain))
    assert figures.shape[1] == width and 0 < below < figures.shape[0] - height


@pytest.mark.parametrize("finest", [Step.B, Step.F])
def test_a_movie_is_drawn_by_the_step_that_the_image_refines_to(
    single: SingleProcess, tmp_path: Path, finest: Step
) -> None:
    scenes = [msgspec.structs.replace(scene, refine=Refine(finest=finest)) for scene in turn(single, 2)]
    job = MovieJob(single, scenes, tmp_path / "turn")
    job.join()
    frame = read_image(tmp_path / "turn" / "frame-00002.png")
    for step in (Step.B, Step.F):
        shown = over_background(single.render(scenes[1], step), scenes[1].image.background)
        assert ((frame - shown).abs().max() <= HALF_A_LEVEL["uint8"]) == (step == finest)


def test_a_cancelled_job_ends_with_the_frame_and_leaves_nothing(gated: Gated, tmp_path: Path) -> None:
    job = MovieJob(gated, turn(gated, 50), tmp_path / "turn")
    for _ in range(2):
        assert gated.asked.acquire(timeout=PATIENCE)
        gated.let.release()
    assert gated.asked.acquire(timeout=PATIENCE)
    job.cancel()
    gated.let.release()
    job.join()
    assert not gated.asked.acquire(blocking=False)
    assert (job.done, job.whole, job.error, job.line) == (True, False, None, "cancelled")
    assert job.progress < 1.0
    assert list(tmp_path.iterdir()) == []


def test_a_job_that_fails_says_why_in_one_line(single: SingleProcess, tmp_path: Path) -> None:
    scenes = turn(single, 3)
    outside = msgspec.structs.replace(scenes[2], bounds=msgspec.structs.replace(scenes[2].bounds, low=(90, 0, 0)))
    job = MovieJob(single, [*scenes[:2], outside], tmp_path / "turn")
    job.join()
    assert job.error is not None and "bounds on i are 90..16" in job.error
    assert (job.done, job.whole, job.line) == (True, False, job.error)
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_refused_at_once(single: SingleProcess, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="there is no folder .*absent; make it first"):
        MovieJob(single, turn(single, 2), tmp_path / "absent" / "turn")


def test_a_name_that_the_system_refuses_is_refused_at_once(single: SingleProcess, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot be written: File name too long"):
        MovieJob(single, turn(single, 2), tmp_path / f"{'頭' * 84}.mp4")
