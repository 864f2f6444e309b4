"""`import volsplat as vs` in scripts as people write them: images, files, pages, and ends without a word."""

from __future__ import annotations

import asyncio
import os
import pickle
import re
import signal
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import psutil
import pytest
import tifffile
import torch
from PIL import Image

import volsplat as vs
from support.checkout import ROOT
from support.pages import patient_http
from support.patience import PATIENCE, wait_until
from volsplat.client.image.image_file import read_scene
from volsplat.client.scene.lit_from import lit_from
from volsplat.client.script import page_window, plotting
from volsplat.client.script.notebook_cells import in_notebook
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import PaperStep
from volsplat.protocol.description.scene import Refine

Z, Y, X = np.mgrid[:16, :16, :16] - 8
BALL = vs.Volume((X * X + Y * Y + Z * Z < 30).astype(np.uint8) * 200, spacing=(1, 1, 1), name="ball")
SCRIPT = """
import numpy, volsplat as vs
array = numpy.zeros((16, 16, 16), "uint8"); array[4:12, 4:12, 4:12] = 200
volume = vs.Volume(array, spacing=(1, 1, 1), name="cube")
"""


@pytest.fixture(scope="module")
def image() -> vs.RenderedImage:
    return vs.render(BALL, size=(40, 30), background="white", rotation="front")


def test_an_image_is_numbers_and_a_picture(image: vs.RenderedImage) -> None:
    assert image.numpy().shape == (30, 40, 4) and image.numpy().dtype == np.float32 and image.numpy().max() > 0
    assert torch.equal(image.tensor, torch.from_numpy(image.numpy())) and np.array_equal(
        np.asarray(image), image.tensor
    )
    assert image.pil().size == (40, 30) and image.pil().getpixel((0, 0)) == (255, 255, 255)
    with Image.open(BytesIO(image._repr_png_())) as shown:
        assert np.array_equal(np.asarray(shown), np.asarray(image.pil()))
    assert isinstance(image.view.zoom, float)


def test_a_saved_image_holds_its_scene(image: vs.RenderedImage, tmp_path: Path) -> None:
    image.save(tmp_path / "ball.png")
    assert read_scene(tmp_path / "ball.png") == image.scene


def test_images_can_be_sent_from_process_to_process(image: vs.RenderedImage, tmp_path: Path) -> None:
    both: list[vs.RenderedImage | vs.RenderedFigure] = [image, image.figure(text_size=4)]
    for number, one in enumerate(both):
        sent = pickle.loads(pickle.dumps(one))
        for picture, path in ((one, tmp_path / f"{number}.png"), (sent, tmp_path / f"{number}-sent.png")):
            picture.save(path)
        assert (tmp_path / f"{number}-sent.png").read_bytes() == (tmp_path / f"{number}.png").read_bytes()
    assert pickle.loads(pickle.dumps(image)).tensor.equal(image.tensor)


def test_what_had_to_be_assumed_of_a_volume_is_a_warning_at_the_call(tmp_path: Path) -> None:
    (tmp_path / "slices").mkdir()
    for number in range(4):
        Image.fromarray(np.full((8, 8), 50 * number, np.uint8)).save(tmp_path / "slices" / f"{number}.png")
    with pytest.warns(vs.VolumeNote, match="pictures state no size of their voxels") as told:
        vs.render(tmp_path / "slices", size=16)
    assert [warning.filename for warning in told] == [__file__]
    with pytest.warns(vs.VolumeNote, match="a block without structure"):
        vs.render(vs.Volume(np.ones((4, 4, 4), np.float32), spacing=(1, 1, 1)), size=16)


def test_a_value_that_leaves_the_others_no_densities_is_told_of() -> None:
    """A fill value that nobody declared makes all others alike; of a single voxel it is left out of account."""
    values = np.random.default_rng(3).normal(size=(16, 16, 16)).astype(np.float32)
    values[3, 4, 5] = 1e20
    with pytest.warns(
        vs.VolumeNote, match=r"few voxels have values as far off as 1e\+20: all others have -3\.\d+ to 3"
    ):
        vs.render(vs.Volume(values, spacing=(1, 1, 1)), size=16)
    values[:7] = 1e20
    with pytest.warns(vs.VolumeNote, match=r"voxels that have 1e\+20 make nearly all others one density"):
        vs.render(vs.Volume(values, spacing=(1, 1, 1)), size=16)


def test_whole_numbers_that_float64_cannot_tell_apart_are_not_called_one_value() -> None:
    values = np.full((8, 8, 8), 2**53, np.uint64)
    values[4:] += np.uint64(1)
    with pytest.warns(vs.VolumeNote, match="can be told apart beyond 2\\^53; subtract the least"):
        vs.render(vs.Volume(values, spacing=(1, 1, 1)), size=16)


@pytest.mark.parametrize("place", ["in a notebook", "on a display"])
def test_whatever_shows_a_volume_warns_of_what_is_odd_about_it(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = list[vs.Session]()

    class Small(vs.Session):
        def __init__(self, volume: object) -> None:
            super().__init__(volume, workers=1, threads=1)
            opened.append(self)

    def shown(session: vs.Session, *asked: object) -> None:
        assert session is opened[0]

    async def plotted() -> None:
        if (widget := vs.plot(vs.Volume(np.ones((4, 4, 4), np.float32), spacing=(1, 1, 1)))) is not None:
            widget.close()

    monkeypatch.setattr(plotting, "in_notebook", lambda: place == "in a notebook")
    monkeypatch.setattr(page_window, "show_page", shown)
    monkeypatch.setattr(plotting, "Session", Small)
    monkeypatch.setenv("DISPLAY", ":0")
    try:
        with pytest.warns(vs.VolumeNote, match="a block without structure") as told:
            asyncio.run(plotted())
        assert [warning.filename for warning in told] == [__file__]
    finally:
        opened[0].close()


def test_what_is_looked_at_in_a_notebook_is_a_line(image: vs.RenderedImage) -> None:
    assert repr(BALL) == "<volsplat volume in memory ball: 16 x 16 x 16 voxels of uint8>"
    with vs.open(BALL, workers=1, threads=1) as session:
        assert repr(session.volume) == "<volsplat volume ball: 16 x 16 x 16 voxels of uint8, 0 to 200>"
        assert repr(session) == "<volsplat session of ball>"
        with pytest.raises(TypeError, match="cannot be copied or pickled; open another"):
            pickle.dumps(session)
    assert repr(session) == "<volsplat session of ball, closed>"


def test_presets_are_there_by_name() -> None:
    drawn = vs.render(BALL, "depth-cue", size=16)
    assert drawn.scene.cross_bar.modu == "screen-z" and "depth-cue" in vs.presets
    assert vs.render(BALL, vs.presets["Depth-Cue"], size=16).scene == drawn.scene
    with pytest.raises(vs.BadInput, match="did you mean ct-bone"):
        vs.render(BALL, "ct-bones")


def test_a_preset_that_does_not_suit_the_values_is_drawn_with_a_warning_at_the_call() -> None:
    with pytest.warns(vs.UnsuitedPreset, match="both sides of 0") as told:
        vs.render(BALL, "difference-map", size=16)
    assert [warning.filename for warning in told] == [__file__]


def test_an_image_that_shows_nothing_is_drawn_with_a_warning_that_says_why() -> None:
    mask = vs.Volume(np.arange(512).reshape(8, 8, 8) < 256, spacing=(1, 1, 1))
    with pytest.warns(vs.EmptyImage, match="nothing is visible: the tables leave all") as told:
        assert not vs.render(mask, "depth-cue", size=16).numpy().any()
    assert [warning.filename for warning in told] == [__file__]


def test_a_label_outside_a_chosen_scene_is_drawn_without_with_a_warning_that_names_it() -> None:
    ball = np.linalg.norm(np.indices((40, 40, 40)) - 19.5, axis=0) < 8
    volume = vs.Volume(ball, spacing=(1, 1, 1))
    labels = (("middle", (20.0, 20.0, 20.0)), ("corner", (0.0, 39.0, 39.0)))
    with pytest.warns(vs.MissingLabel, match="lacks the label corner: what it points at lies outside") as told:
        vs.render(volume, figure=vs.Figure(labels=labels, dpi=72), size=96)
    assert [warning.filename for warning in told] == [__file__]


def test_a_session_that_is_open_is_drawn_by(image: vs.RenderedImage) -> None:
    with vs.open(BALL, workers=1, threads=1) as session:
        drawn = vs.render(session, image.scene)
        assert np.array_equal(drawn.numpy(), image.numpy()) and session.server_processes


@pytest.mark.parametrize("is_cell", [True, False])
def test_a_cell_of_marimo_is_one_of_a_notebook(is_cell: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "marimo", SimpleNamespace(running_in_notebook=lambda: is_cell))
    assert in_notebook() is is_cell


def test_plot_without_a_display_writes_a_picture(tmp_path: Path) -> None:
    np.save(tmp_path / "ball.v1.npy", np.arange(4096, dtype=np.uint16).reshape(16, 16, 16))
    said = in_script(tmp_path, "import volsplat as vs; vs.plot('ball.v1.npy', size=20)")
    assert said == "ball.v1.png\n"
    with Image.open(tmp_path / "ball.v1.png") as picture:
        assert picture.size == (20, 20) and np.asarray(picture).max() > 0


def test_pictures_that_plot_names_replace_none_but_those_of_earlier_scripts(tmp_path: Path) -> None:
    values = np.arange(4096, dtype=np.uint16).reshape(16, 16, 16)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["entry/a"], file["entry/b"] = values, values
    (tmp_path / "brain.png").write_bytes(b"somebody's own")
    script = (
        "import numpy as np, volsplat as vs\n"
        "values = np.arange(4096, dtype=np.uint16).reshape(16, 16, 16)\n"
        "brain = vs.Volume(values, name='brain', spacing=(1, 1, 1))\n"
        "long = vs.Volume(values, name=130 * 'ö', spacing=(1, 1, 1))\n"
        "vs.render(brain, size=20).save('brain-2.png')\n"
        "for volume in ('run.h5#/entry/a', 'run.h5#/entry/b', brain, brain, long):\n"
        "    vs.plot(volume, size=20)\n"
    )
    named = f"run-a.png\nrun-b.png\nbrain-3.png\nbrain-4.png\n{100 * 'ö'}.png\n"
    assert in_script(tmp_path, script) == in_script(tmp_path, script) == named
    assert (tmp_path / "brain.png").read_bytes() == b"somebody's own"


@pytest.mark.filterwarnings("ignore::volsplat.client.script.plotting.VolumeNote")
def test_what_a_script_writes_does_not_replace_the_volume(tmp_path: Path) -> None:
    stack = tmp_path / "stack.tif"
    tifffile.imwrite(stack, np.arange(4096, dtype=np.uint16).reshape(16, 16, 16))
    before, image = stack.read_bytes(), vs.render(stack, size=16)
    writers: list[vs.RenderedImage | vs.RenderedFigure] = [image, image.figure()]
    for writer in writers:
        with pytest.raises(vs.BadInput, match=r"stack.tif: this is the volume itself"):
            writer.save(stack)
    assert stack.read_bytes() == before


def test_a_script_that_forgets_to_close_ends_without_a_word_and_leaves_no_process(tmp_path: Path) -> None:
    code = "session = vs.Session(volume, workers=1, threads=1); session.volume; print(*session.server_processes)"
    processes = [int(number) for number in in_script(tmp_path, SCRIPT + code).split()]
    assert len(processes) == 2 and not any(map(psutil.pid_exists, processes))


def test_a_script_that_is_killed_leaves_neither_processes_nor_memory(tmp_path: Path) -> None:
    code = "session = vs.Session(volume, workers=1, threads=1); session.volume\n"
    code += "print(*session.server_processes, flush=True); input()"
    with started(tmp_path, SCRIPT + code) as script:
        assert script.stdout is not None
        processes = [int(number) for number in script.stdout.readline().split()]
        script.kill()
    assert len(processes) == 2
    wait_until(lambda: not any(map(psutil.pid_exists, processes)), "the servers end, and with them what they share")


def test_view_serves_the_page_until_it_is_interrupted(tmp_path: Path) -> None:
    with started(tmp_path, SCRIPT + "vs.view(volume, browser=False, size=32); print('and on')") as script:
        assert script.stdout is not None
        assert re.match(r"cube is at http://127\.0\.0\.1:\d+/\?", script.stdout.readline())
        script.send_signal(signal.SIGINT)
        assert script.communicate(timeout=PATIENCE) == ("and on\n", "")


@pytest.mark.parametrize("scene", [None, "ct-bone"])
@pytest.mark.filterwarnings("ignore::volsplat.client.script.plotting.UnsuitedPreset")
def test_what_is_watched_is_lit_from_its_first_steps_unless_the_caller_says_otherwise(scene: str | None) -> None:
    with SingleProcess(BALL) as session:
        volume = session.volume
        watched = plotting._scene(volume, scene, {}, watched=True)
        assert watched.refine.lit_from is PaperStep.C
        assert lit_from(watched, PaperStep.E) == plotting._scene(volume, scene, {}) == volume.begun_scene(scene)
        own = lit_from(watched, PaperStep.D)
        assert plotting._scene(volume, own, {}, watched=True) == own
        said = plotting._scene(volume, scene, {"refine": Refine(lit_from=PaperStep.E)}, watched=True)
        assert said.refine.lit_from is PaperStep.E


def test_cells_of_a_notebook_show_the_page_one_after_another_and_keep_their_session(tmp_path: Path) -> None:
    """A notebook's cells run within an event loop, all in one process."""
    code = """
async def cells():
    with vs.open(volume, workers=1, threads=1) as session:
        for cell in range(2):
            vs.view(session, browser=False, size=32)
        print(session.render(session.default_scene().with_(size=32)).max() > 0)
import asyncio; asyncio.new_event_loop().run_until_complete(cells())
"""
    with started(tmp_path, SCRIPT + code) as script:
        assert script.stdout is not None
        for _cell in range(2):
            address = script.stdout.readline().removeprefix("cube is at ").strip()
            with patient_http.Client(follow_redirects=True) as browser:
                assert "cube" in browser.get(address).raise_for_status().text
            script.send_signal(signal.SIGINT)
        assert script.communicate(timeout=PATIENCE) == ("tensor(True)\n", "")


def test_a_process_serves_one_page_at_a_time(tmp_path: Path) -> None:
    code = """
import threading
def second():
    input()
    try:
        vs.view(volume, browser=False)
    except vs.BadInput as error:
        print(error, flush=True)
threading.Thread(target=second).start()
vs.view(volume, browser=False)
"""
    with started(tmp_path, SCRIPT + code) as script:
        assert script.stdin is not None and script.stdout is not None
        script.stdout.readline()
        print(file=script.stdin, flush=True)
        assert script.stdout.readline().startswith("this process serves a page already; end that one first")
        script.send_signal(signal.SIGINT)
        assert script.communicate(timeout=PATIENCE) == ("", "")


def started(folder: Path, code: str) -> subprocess.Popen[str]:
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", code],
        cwd=folder,
        env=bare,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )


def in_script(folder: Path, code: str) -> str:
    """What a script prints that ends without a complaint."""
    with started(folder, code) as script:
        said, complaint = script.communicate(timeout=PATIENCE)
    assert (script.returncode, complaint) == (0, "")
    return said


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"kind": "MR"}, r"kind= is of the volume, not of its scene: vs\.Volume\(array, kind='MR'\)"),
        ({"spacing": (1, 1, 2)}, r"vs\.Volume\(array, spacing=\(1, 1, 2\)\)"),
        ({"preset": "ct-bone"}, "a preset is given as the scene: scene='ct-bone'"),
    ],
)
def test_what_is_no_key_of_a_scene_is_told_where_it_belongs(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(vs.BadInput, match=told):
        vs.render(BALL, **changes)


def test_the_page_of_every_name_has_every_name() -> None:
    page = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. (?:auto|py:)\w+:: (?:volsplat\.)?(\w+)$", page, re.MULTILINE)
    assert sorted(set(listed) - {"volsplat"}) == sorted(vs.__all__)
